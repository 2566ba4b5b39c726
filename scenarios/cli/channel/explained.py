"""What a vehicle knew at an instant, as a table for a person."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from scenarios.cli.whole import print_whole
from scenarios.results.inquiry.explain import (
    ON_THE_WAY,
    SHOWN,
    Explanation,
    KnownSource,
    MissingMessage,
)


def print_explanation(found: Explanation, console: Console) -> None:
    """Print the sentence, what was known of each source, and what was missing."""
    console.print(found.sentence, highlight=False, markup=False, soft_wrap=True)
    if not found.sources:
        return
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("source", no_wrap=True)
    for heading in ("newest\nmessage", "measured\nat, s", "known\nat, s", "age\ns",
                    "path\nleft, m", "received in the\nlast second, %"):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for one in found.sources:
        table.add_row(one.sender, *_cells(one))
    print_whole(table, console)
    for one in found.sources:
        for missing in one.missing[:SHOWN]:
            console.print(_missing(one.sender, missing), highlight=False, markup=False)
        if len(one.missing) > SHOWN:
            console.print(f"{one.sender}: {len(one.missing) - SHOWN} more are missing")


def _cells(one: KnownSource) -> tuple[str, ...]:
    return (
        "-" if one.number is None else str(one.number),
        _number(one.measured_at_s, 2),
        _number(one.heard_at_s, 2),
        _number(one.age_s, 3),
        _number(one.path_left_m, 1),
        _number(None if one.received_ratio is None else 100.0 * one.received_ratio, 0),
    )


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _missing(sender: str, one: MissingMessage) -> str:
    name = f"{sender} message {one.number}, sent at {one.sent_at_s:.2f} s"
    if one.fate == ON_THE_WAY:
        return f"{name}: on the way, there at {one.due_at_s:.2f} s"
    due = f", was due at {one.due_at_s:.2f} s" if one.due_at_s is not None else ""
    return f"{name}: {one.fate}{f' by {one.cause}' if one.cause else ''}{due}"
