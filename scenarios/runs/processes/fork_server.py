"""Process context of the fork server, a process with one thread that has imported modules once."""

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import forkserver, get_all_start_methods, get_context, resource_tracker
from multiprocessing.context import BaseContext
from types import ModuleType

from scenarios.runs.stop import STOP_SIGNALS, delayed_exit

SAFE_PATH = "PYTHONSAFEPATH"
"""Variable with which Python does not search the working folder."""


def fork_server(preload: Sequence[str]) -> BaseContext:
    """Context of a fork server that imports `preload`; of new programs where there is no fork."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload(list(preload))
    return context


@contextmanager
def starting_processes() -> Iterator[None]:
    """Let processes start with blocked stop signals, and without importing the caller's script.

    The script would run again. An end of this process in the meantime would make the new ones
    print a traceback. They import no packages from the working folder in place of the installed
    ones: the fork server imports before it gets the search path of this process.
    """
    main, safe_path = sys.modules["__main__"], os.environ.get(SAFE_PATH)
    resource_tracker.ensure_running()  # it unblocks the signals
    with delayed_exit():
        before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
        sys.modules["__main__"] = ModuleType("__main__")
        os.environ[SAFE_PATH] = "1"
        try:
            yield
        finally:
            del os.environ[SAFE_PATH]
            if safe_path is not None:
                os.environ[SAFE_PATH] = safe_path
            sys.modules["__main__"] = main
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def stop_fork_server() -> None:
    """Wait for the end of the fork server, whose children have all ended, and of its helper.

    They would end by themselves, but a little after this process.
    """
    forkserver._forkserver._stop()  # type: ignore[attr-defined]
    resource_tracker._resource_tracker._stop()  # type: ignore[attr-defined]
