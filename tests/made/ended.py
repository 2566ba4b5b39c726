"""Whether a process that a test watches has come to its end."""

import psutil


def has_ended(process: psutil.Process) -> bool:
    """Whether it is gone, or a zombie that nobody has waited for yet."""
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:  # between the two questions
        return True
