"""Standard output and error that may be closed, full or limited in characters."""

import io
import os
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import click

from scenarios.runs.stop import EXIT_FAILED

ERROR_PATIENCE_S = 0.5
"""How long progress and errors wait for a reader that does not read; then they are dropped."""


def open_standard_files() -> None:
    """Open the null device in place of closed standard files.

    Otherwise a file opened later would get their number and receive the output.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:
                os.dup2(opened, number, inheritable=True)
                os.close(opened)
            else:
                os.set_inheritable(number, True)


class Output(io.FileIO):
    """A standard file that drops bytes it cannot write, so that the command continues.

    `failure` is the first error. A closed pipe, as in `convoy run | head -1`, is not a failure.
    `patience_s` limits the wait for a reader that does not read; None is no limit.
    """

    failure: OSError | None = None
    patience_s: float | None = None
    _is_stuck = False

    def write(self, data: Any, /) -> int:
        left = memoryview(data).cast("B")
        size = left.nbytes
        try:
            while left.nbytes and self._is_ready():
                # A pipe takes a part of this size completely, or none of it.
                left = left[super().write(left[: select.PIPE_BUF]) or 0 :]
        except BrokenPipeError:
            pass
        except OSError as error:
            self.failure = self.failure or error
        return size

    def _is_ready(self) -> bool:
        """Wait until the file takes bytes, but not again for a reader that was stuck."""
        timeout_s = 0.0 if self._is_stuck else self.patience_s
        self._is_stuck = not select.select([], [self], [], timeout_s)[1]
        return not self._is_stuck


def keep_output_going() -> None:
    """Make printing raise no error; the encoding's missing characters become question marks."""
    sys.stdout = _lenient(sys.__stdout__ and sys.stdout, 1, None)
    sys.stderr = _lenient(sys.__stderr__ and sys.stderr, 2, ERROR_PATIENCE_S)


@contextmanager
def unwritable_output_reported() -> Iterator[None]:
    """Exit with an error if the standard output is incomplete."""
    try:
        yield
    except SystemExit as end:
        sys.stdout.flush()
        raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
        if end.code or not isinstance(raw, Output) or raw.failure is None:
            raise
        sys.stderr.write(f"error: standard output: {raw.failure.strerror}\n".lower())
        raise SystemExit(EXIT_FAILED) from None


def _lenient(stream: TextIO | None, number: int, patience_s: float | None) -> TextIO:
    if stream is not None:
        stream.flush()
        number = stream.fileno()
    raw = Output(number, "wb", closefd=False)
    raw.patience_s = patience_s
    output = io.BufferedWriter(raw)
    encoding = stream.encoding if stream is not None else "utf-8"
    return io.TextIOWrapper(output, encoding=encoding, errors="replace", line_buffering=True)


def progress_of(what: str) -> Callable[[int, int], None]:
    """Return a function that shows the progress (done, total) on a terminal's standard error."""

    def show(done: int, total: int) -> None:
        if sys.stderr.isatty() and total > 2:
            end = "\n" if done == total else ""
            sys.stderr.write(f"\r{done} of {total} {what}{end}")
            sys.stderr.flush()

    return show


def wait_until_stopped(address: str) -> None:
    """Print the address of a served picture, and wait for Ctrl-C."""
    from scenarios.runs.stop import stop_on_signals
    from transport.clock import poll

    click.echo(f"open {address}\nstop with Ctrl-C")
    stop = stop_on_signals()
    poll(lambda: stop.requested, every_s=0.1)
