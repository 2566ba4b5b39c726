"""Standard output and error that may be closed, full or limited to few letters."""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from scenarios.runs.stop import EXIT_FAILED


def open_standard_files() -> None:
    """Open the null device in place of closed standard files.

    Otherwise another file would get their number, and receive what is printed.
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
    """A standard file that drops unwritable bytes, so that the command goes on.

    `failure` is the first error, unless the reader is gone, as after `convoy run | head -1`.
    """

    failure: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write what can be written; returns the number of bytes as if all were."""
        try:
            return super().write(data)
        except BrokenPipeError:
            pass
        except OSError as error:
            self.failure = self.failure or error
        return memoryview(data).nbytes


def keep_output_going() -> None:
    """Let printing raise no error; letters that the encoding lacks become question marks."""
    sys.stdout = _lenient(sys.__stdout__ and sys.stdout, 1)
    sys.stderr = _lenient(sys.__stderr__ and sys.stderr, 2)


@contextmanager
def unwritable_output_reported() -> Iterator[None]:
    """Turn the end of a command into a failure if its standard output is incomplete."""
    try:
        yield
    except SystemExit as end:
        sys.stdout.flush()
        raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
        if end.code or not isinstance(raw, Output) or raw.failure is None:
            raise
        sys.stderr.write(f"standard output: {raw.failure.strerror}\n".lower())
        raise SystemExit(EXIT_FAILED) from None


def _lenient(stream: TextIO | None, number: int) -> TextIO:
    if stream is not None:
        stream.flush()
        number = stream.fileno()
    output = io.BufferedWriter(Output(number, "wb", closefd=False))
    encoding = stream.encoding if stream is not None else "utf-8"
    return io.TextIOWrapper(output, encoding=encoding, errors="replace", line_buffering=True)
