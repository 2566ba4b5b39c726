"""What a vehicle knew at an instant, as a table for a person."""

from collections.abc import Sequence

from rich.console import Console

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.results.log_queries.explain import (
    IN_TRANSIT,
    SHOWN,
    Explanation,
    KnownSource,
    MissingMessage,
)

COLUMNS: Sequence[Column[KnownSource]] = (
    Column("source", lambda one: one.sender, left=True),
    Column("newest\nmessage", lambda one: one.number),
    Column("measured\nat, s", lambda one: one.measured_at_s, ".2f"),
    Column("known\nat, s", lambda one: one.received_at_s, ".2f"),
    Column("age\ns", lambda one: one.age_s, ".3f"),
    Column("path\nleft, m", lambda one: one.path_left_m, ".1f"),
    Column("received in the\nlast second, %", lambda one: one.received_ratio, ".0f", 100.0),
)


def print_explanation(found: Explanation, console: Console) -> None:
    console.print(found.sentence, highlight=False, markup=False, soft_wrap=True)
    if not found.sources:
        return
    print_whole(table_of(COLUMNS, found.sources), console)
    for one in found.sources:
        for missing in one.missing[:SHOWN]:
            console.print(_missing(one.sender, missing), highlight=False, markup=False)
        if len(one.missing) > SHOWN:
            console.print(f"{one.sender}: {len(one.missing) - SHOWN} more are missing")


def _missing(sender: str, one: MissingMessage) -> str:
    name = f"{sender} message {one.number}, sent at {one.sent_at_s:.2f} s"
    if one.fate == IN_TRANSIT:
        return f"{name}: in transit, due at {one.due_at_s:.2f} s"
    due = f", was due at {one.due_at_s:.2f} s" if one.due_at_s is not None else ""
    return f"{name}: {one.fate}{f' by {one.cause}' if one.cause else ''}{due}"
