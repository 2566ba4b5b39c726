"""The log of a virtual run, written by a process of its own where another core is free."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import BinaryIO, cast

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.pool import cores
from scenarios.runs.processes.forking import Birth, can_fork, fork_all
from scenarios.runs.run_log import log_writer
from scenarios.runs.stop import ignore_signals
from transport.log.aside import AsideWriter, serve
from transport.log.message_log import MessageLog

PIPE_BYTES = 1 << 20
"""So much may wait in the pipe, as a chunk of the log holds: what writes it has pauses."""


@contextmanager
def log_aside(scenario: Scenario, folder: Path) -> Iterator[MessageLog | None]:
    """Give the log of a run of `scenario` in `folder`, written aside; None where that cannot be.

    To be called before there are other threads: with those, or on a single core, a run writes its
    log itself. The other process is deaf to signals; it ends when the log is complete.
    """
    if cores() < 2 or not can_fork():
        yield None
        return
    deed = partial(_write, scenario, folder)
    [child] = fork_all([Birth("log", ["run", scenario.name], deed, piped=True)])
    with suppress(OSError, AttributeError):  # not everywhere, and not for everybody
        fcntl.fcntl(child.stdin, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
    try:
        answers = cast("BinaryIO", child.stdout)  # it is piped
        with AsideWriter(folder / LOG_NAME, child.stdin, answers) as writer:
            yield writer
    finally:
        child.wait()


def _write(scenario: Scenario, folder: Path) -> None:
    ignore_signals()
    calls = os.fdopen(0, "rb", closefd=False)
    answers = os.fdopen(1, "wb", buffering=0, closefd=False)  # nothing waits that nobody reads
    serve(partial(log_writer, scenario, folder), calls, cast("BinaryIO", answers))
