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
from scenarios.runs.cores import cores
from scenarios.runs.processes.forking import Birth, can_fork, fork_all
from scenarios.runs.stop import ignore_signals
from transport.log.aside.writer import AsideWriter
from transport.log.message_log import MessageLog

PIPE_BYTES = 1 << 20
"""So much may wait in the pipe, as a chunk of the log holds: what writes it has pauses."""


@contextmanager
def log_aside(scenario: Scenario, folder: Path) -> Iterator[MessageLog | None]:
    """Give the log of a run of `scenario` in `folder`, written aside; None where that cannot be.

    To be called before there are other threads: with those, or on a single core, a run writes its
    log itself. The other process loads by itself what it needs for that, so whoever has more to
    load does it best in the meantime. It is deaf to signals, and ends when the log is complete.
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
    from scenarios.runs.log_file import log_writer  # noqa: PLC0415 - see above
    from transport.log.aside.server import serve  # noqa: PLC0415

    calls = os.fdopen(0, "rb", closefd=False)
    answers = os.fdopen(1, "wb", buffering=0, closefd=False)  # nothing waits that nobody reads
    serve(partial(log_writer, scenario, folder), calls, cast("BinaryIO", answers))
