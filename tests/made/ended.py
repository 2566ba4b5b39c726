"""Whether a process has ended."""

import psutil


def has_ended(process: psutil.Process) -> bool:
    """Whether a process does not exist, or is a zombie."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # ended between the two calls
        return True
