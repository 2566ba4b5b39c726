"""What a vehicle knew at a time, as a table."""

from collections.abc import Sequence

from rich.console import Console

from scenarios.cli.columns import Column, print_whole, table_of
from scenarios.results.log_queries.explain import (
    IN_TRANSIT,
    SHOWN,
    Explanation,
    KnownSource,
    MissingMessage,
    cause_of,
    counts_of,
    fate_of,
)

COLUMNS: Sequence[Column[KnownSource]] = (
    Column("source", lambda source: source.sender, left=True),
    Column("use", lambda source: source.use.replace(" and ", "\n"), left=True),
    Column("status", lambda source: source.status or None, left=True),
    Column("newest\nmessage", lambda source: source.number),
    Column("measured\nat, s", lambda source: source.measured_at_s, ".2f"),
    Column("available\nat, s", lambda source: source.received_at_s, ".2f"),
    Column("age\ns", lambda source: source.age_s, ".3f"),
    Column("known path\nahead, m", lambda source: source.path_left_m, ".1f"),
    Column("received in the\nlast second, %", lambda source: source.received_ratio, ".0f", 100.0),
)


def print_explanation(explanation: Explanation, console: Console) -> None:
    console.print(explanation.sentence, highlight=False, markup=False, soft_wrap=True)
    if not explanation.sources:
        return
    print_whole(table_of(COLUMNS, explanation.sources), console)
    for source in explanation.sources:
        for message in source.missing[:SHOWN]:
            console.print(
                _missing(source.sender, message), highlight=False, markup=False, soft_wrap=True
            )
        if len(source.missing) > SHOWN:
            rest = source.missing[SHOWN:]
            line = f"{source.sender}: {len(rest)} more messages: {counts_of(rest)}"
            console.print(line, highlight=False, markup=False, soft_wrap=True)


def _missing(sender: str, message: MissingMessage) -> str:
    name = f"{sender} message {message.number}, sent at {message.sent_at_s:.2f} s"
    if message.fate == IN_TRANSIT:
        due = "after the end" if message.due_at_s is None else f"at {message.due_at_s:.2f} s"
        return f"{name}: in transit, due {due}"
    cause = f" ({cause_of(message)})" if message.cause else ""
    due = "" if message.due_at_s is None else f", would have arrived at {message.due_at_s:.2f} s"
    return f"{name}: {fate_of(message)}{cause}{due}"
