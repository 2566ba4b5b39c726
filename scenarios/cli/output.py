"""Standard output and error that may be closed, full or limited in characters."""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:  # rich is loaded when a table is printed
    from rich.console import Console
    from rich.table import Table

    from scenarios.results.summary_columns import Column
import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import click

from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED
from transport.log.errors import UnwritableError
from transport.picture.viewer_process import UnwritableRecordingError
from transport.texts import ConvoyError

# ---- Printed tables: their columns are data, and one function renders them


Row = TypeVar("Row")

UNBOUNDED = 100_000


def table_of(
    columns: "Sequence[Column[Row]]",
    rows: Iterable[Row],
    style: Callable[[Row], str | None] | None = None,
    **options: Any,
) -> "Table":
    """Make a table; `style` is that of a row, `options` are those of rich's tables."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(**{"box": SIMPLE_HEAD, "padding": (0, 1, 0, 0), **options})
    for column in columns:
        table.add_column(
            column.heading,
            justify="left" if column.left else "right",
            no_wrap=not column.wraps,
            max_width=column.max_width,
        )
    for row in rows:
        cells = (column.cell(row) for column in columns)
        table.add_row(*cells, style=style(row) if style else None)
    return table


def grid_of(rows: Iterable[tuple[str, ...]]) -> "Table":
    """Make a table without headings and lines; the last column takes the remaining width."""
    from rich.markup import escape
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 0))
    for place, row in enumerate(rows):
        if not place:
            for _ in row[:-1]:
                table.add_column(no_wrap=True)
            table.add_column()
        table.add_row(*map(escape, row))
    return table


def print_whole(table: "Table", console: "Console") -> None:
    """Print a table without cutting its figures.

    In a narrow terminal, rich would shorten cells to an ellipsis. Tables without wrapping columns
    are printed in full width instead.
    """
    from rich.measure import Measurement

    if all(column.no_wrap for column in table.columns):
        unbounded = console.options.update(width=UNBOUNDED)
        needed = Measurement.get(console, unbounded, table).maximum
        if needed > console.width:
            table.width = needed
    console.print(table, crop=False)


def worst_rows(rows: Sequence[Row], trouble: Callable[[Row], float], most: int | None) -> list[Row]:
    """The `most` rows with the largest `trouble`, in their own order; all rows for None."""
    worst = sorted(range(len(rows)), key=lambda place: -trouble(rows[place]))[:most]
    return [rows[place] for place in sorted(worst)]


# ---- Errors of commands: `error: where: what, what is allowed`, and an exit code


UNWRITABLE = {errno.EACCES, errno.EDQUOT, errno.EIO, errno.ENOSPC, errno.EPERM, errno.EROFS}
"""Faults of the destination, not of the input."""


def error_line(text: str) -> str:
    return f"error: {text}"


def print_error(text: str) -> None:
    for line in text.splitlines():
        click.echo(error_line(line), err=True)


@contextmanager
def clear_errors() -> Iterator[None]:
    """Print errors in the input to standard error and exit with their code."""
    exit_code = EXIT_BAD_INPUT
    try:
        yield
    except ConvoyError as error:
        print_error(str(error))
        if isinstance(error, UnwritableError | UnwritableRecordingError):
            exit_code = EXIT_FAILED
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        print_error(f"{place}{(error.strerror or str(error)).lower()}")
        if error.errno in UNWRITABLE:
            exit_code = EXIT_FAILED
    else:
        return
    raise SystemExit(exit_code)


def warn_of_log(faults: str) -> None:
    """Print damage and holes of a log, if any, to standard error."""
    if faults:
        click.echo(f"warning: {faults}", err=True)


# ---- Output


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
