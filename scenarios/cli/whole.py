"""Tables whose figures are never cut, however narrow the terminal is."""

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

UNBOUNDED = 100_000


def print_whole(table: Table, console: Console) -> None:
    """Print a table that no column of may wrap at the width it needs.

    Rich would cut its cells to an ellipsis: half a figure is worse than a line that the terminal
    wraps, and a pipe or a file has no width at all. Tables that can wrap do.
    """
    if all(column.no_wrap for column in table.columns):
        unbounded = console.options.update(width=UNBOUNDED)
        needed = Measurement.get(console, unbounded, table).maximum
        if needed > console.width:
            table.width = needed
    console.print(table, crop=False)
