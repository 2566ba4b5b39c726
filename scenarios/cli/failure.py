"""How commands fail: one clear line for each problem, an exit code, no traceback."""

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

import click

from scenarios.definition.errors import ScenarioError
from scenarios.runs.stop import EXIT_BAD_INPUT
from transport.bus.bus import BusError
from transport.log.records import LogError
from transport.picture.viewer_process import ViewerError


@contextmanager
def clear_errors() -> Iterator[None]:
    """Turn the errors that a user can do something about into lines and an exit code."""
    try:
        yield
    except (ScenarioError, BusError, LogError, ViewerError) as error:
        for line in str(error).splitlines():
            click.echo(line, err=True)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        click.echo(f"{where}{(error.strerror or str(error)).lower()}", err=True)
    else:
        return
    raise SystemExit(EXIT_BAD_INPUT)


class _Pipe(io.FileIO):
    """Standard output or error: what nobody reads any more is dropped, and the command goes on."""

    def write(self, data: Any, /) -> int:
        """Write, unless the reader is gone, as after `convoy run | head -1`."""
        try:
            return super().write(data)
        except BrokenPipeError:
            return memoryview(data).nbytes


def outlive_readers() -> None:
    """A closed pipe at standard output or error is from now on no error for this process."""
    if sys.stdout is not None:
        sys.stdout = _outliving(sys.stdout)
    if sys.stderr is not None:
        sys.stderr = _outliving(sys.stderr)


def _outliving(stream: TextIO) -> TextIO:
    """Return a stream like `stream` on the same file descriptor, without its broken pipes."""
    stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Pipe(stream.fileno(), "wb", closefd=False)),
        encoding=stream.encoding,
        errors=stream.errors,
        line_buffering=True,
    )
