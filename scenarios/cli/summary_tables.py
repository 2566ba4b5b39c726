"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from scenarios.cli.common_options import Tables
from scenarios.cli.output import print_whole, table_of, worst_rows
from scenarios.results.links import LinkSummary
from scenarios.results.outcome import with_outcome_line
from scenarios.results.record import hole_lines
from scenarios.results.summary import RunChange, RunSummary
from scenarios.results.summary_columns import (
    EVENT_COLUMNS,
    EVENT_NAMES,
    Column,
    SummaryTable,
    has_link_news,
    tables_of,
)
from scenarios.studies.explain import (
    IN_TRANSIT,
    SHOWN,
    Explanation,
    KnownSource,
    MissingMessage,
    cause_of,
    counts_of,
    fate_of,
)

MOST_CHANGES = 3
"""Changes in the title."""
MOST_EVENTS, MOST_NEW_EVENTS = 40, 10
MOST_HOLES = 10
UNTITLED = ("vehicles", "processes")
"""Tables whose columns need no title."""
MOST_LINKS = 40
"""Printed rows at most, of links those that lost most; the summary has them all."""


def print_summary(
    summary: RunSummary, log: Path | None, console: Console, tables: Tables = "all"
) -> None:
    """Print the title, tables, warnings, the outcome line and the log's path, in this order.

    `tables` are all, or only that of the vehicles and those with news.
    """
    console.print(Text(title_of(summary), style="bold"), highlight=False, soft_wrap=True)
    for table in tables_of(summary):
        if table.is_news or tables == "all":
            print_whole(_printed(table), console)
    if summary.events:
        most = MOST_EVENTS if tables == "all" else MOST_NEW_EVENTS
        print_whole(event_table(summary, most), console)
    has_tables = tables == "all" or any(
        has_link_news(row, summary.warnings) for row in summary.links
    )
    if not has_tables and (losses := _losses(summary)):
        _print_line(losses, console)
    for line in (*_unrecorded(summary), *summary.warnings, *_all_reasons(summary)):
        _print_line(line, console)
    outcome = Text(with_outcome_line(summary).outcome_line)
    outcome.highlight_regex(r"^FAILED:", "bold red")
    outcome.highlight_regex(r"^OK\b", "bold green")
    console.print(outcome, highlight=False, soft_wrap=True)
    if log is not None:
        _print_line(f"log: {log}", console)


def _losses(summary: RunSummary) -> str:
    """Compare achieved with requested losses in one line; empty if nothing was lost."""
    lossy = [row for row in summary.links if row.requested_loss_ratio or row.loss_ratio]
    if not lossy:
        return ""
    requested = [row.requested_loss_ratio for row in lossy if row.requested_loss_ratio is not None]
    asked = f", requested {_percent(requested)}" if requested else ""
    links = "1 link" if len(lossy) == 1 else f"{len(lossy)} links"
    return f"messages lost: {_percent([row.loss_ratio for row in lossy])} of {links}{asked}"


def _percent(ratios: Sequence[float]) -> str:
    low, high = (f"{100.0 * ratio:.1f}".removesuffix(".0") for ratio in (min(ratios), max(ratios)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _print_line(line: str, console: Console) -> None:
    console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)


def _all_reasons(summary: RunSummary) -> Sequence[str]:
    """All reasons of a failure, if the outcome line does not have them all."""
    reasons = summary.reason.split("; ")
    return [f"failed: {reason}" for reason in reasons] if len(reasons) > 1 else []


def title_of(summary: RunSummary) -> str:
    """Name of the run, changes made to it, its clock and its duration."""
    about = summary.identity
    name = about.title or f"{about.scenario}, seed {about.seed}"
    made = [change for change in summary.changes if change.kind not in {"cut", "heal"}]
    parts = [_change_words(change) for change in made[:MOST_CHANGES]]
    if len(made) > MOST_CHANGES:
        parts.append(f"{len(made) - MOST_CHANGES} more changes")
    return ", ".join([name, *parts, f"{about.clock} clock", f"{summary.ran_s:.1f} s"])


def _change_words(change: RunChange) -> str:
    by_hand = " by hand" if change.by_hand else ""
    return " ".join(filter(None, (change.kind, change.target, f"at {change.at_s:.2f} s{by_hand}")))


def event_table(summary: RunSummary, most: int) -> Table:
    kinds = Counter(event.kind for event in summary.events)
    title = "events: " + ", ".join(
        f"{count} {EVENT_NAMES[kind][count > 1]}" for kind, count in kinds.items()
    )
    table = table_of(EVENT_COLUMNS, summary.events[:most], title=title)
    if len(summary.events) > most:
        table.add_row("", f"{len(summary.events) - most} more", "", "see summary.json")
    return table


def _printed(table: SummaryTable) -> Table:
    rows, more = table.rows, len(table.rows) - MOST_LINKS
    if isinstance(rows[0], LinkSummary):
        rows = worst_rows(rows, lambda row: row.loss_ratio, MOST_LINKS)
    else:
        more = 0
    return table_of(
        table.columns,
        rows,
        title=None if table.title in UNTITLED else table.title,
        caption=f"{more} more, see summary.json" if more > 0 else None,
    )


def _unrecorded(summary: RunSummary) -> Iterator[str]:
    yield from hole_lines(summary.holes, MOST_HOLES)
    silent = [row for row in summary.vehicles if row.silent_from_s is not None]
    for row in silent:
        yield f"silent: {row.name} from {row.silent_from_s:.2f} s after the start on"
    if summary.holes or silent:
        yield "the figures cover only what was recorded"


# ---- What a vehicle knew at a time, as a table


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
