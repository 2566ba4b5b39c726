"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from scenarios.cli.common_options import Tables
from scenarios.cli.output import print_whole, table_of, worst_rows
from scenarios.results.explain import (
    IN_TRANSIT,
    SHOWN,
    Explanation,
    KnownSource,
    MissingMessage,
    cause_of,
    counts_of,
    fate_of,
)
from scenarios.results.holes import hole_lines
from scenarios.results.link_summary import LinkSummary, lost_in_transport
from scenarios.results.outcome import with_outcome_line
from scenarios.results.reaction import NO_REACTION
from scenarios.results.string_figures import STRING_SIGNALS, StringFigures
from scenarios.results.summary import RunChange, RunSummary
from scenarios.results.summary_columns import (
    ALARM_COLUMN,
    DETAIL_COLUMNS,
    EVENT_COLUMNS,
    EVENT_NAMES,
    FRESHNESS_COLUMNS,
    LINK_COLUMNS,
    PROCESS_COLUMNS,
    REACTION_COLUMNS,
    TRANSPORT_COLUMNS,
    VEHICLE_COLUMNS,
    Column,
    gain_columns,
    link_name,
    message_columns,
    own_columns,
)
from scenarios.results.traffic import OVERRIDDEN_RATIO
from scenarios.results.vehicle_figures import VehicleSummary
from transport.topics import counts_as_loss

MOST_CHANGES = 3
"""Changes in the title."""
REQUESTED_LOSS = re.compile(r", loss [\d.]+( to [\d.]+)? %")
"""Part of a scenario's title."""
LATE_NEWS_RATIO = 0.01
"""Share of late ticks or messages from which a table carries news."""
MOST_EVENTS, MOST_NEW_EVENTS = 40, 10
MOST_HOLES = 10
MOST_LINKS = 40
"""Printed rows at most, of links those that lost most; the summary has them all."""


def print_summary(
    summary: RunSummary, log: Path | None, console: Console, tables: Tables = "all"
) -> None:
    """Print the title, tables, warnings, the outcome line and the log's path, in this order.

    `tables` are all, or only that of the vehicles and those with news.
    """
    console.print(Text(title_of(summary), style="bold"), highlight=False, soft_wrap=True)
    for is_news, table in _tables(summary, tables):
        if is_news or tables == "all":
            print_whole(table, console)
    has_tables = tables == "all" or any(
        _has_link_news(row, summary.warnings) for row in summary.links
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


def _tables(summary: RunSummary, tables: Tables) -> Iterator[tuple[bool, Table]]:
    """Yield the tables of a summary, each with whether it carries news."""
    followers = [row for row in summary.vehicles if row.role != "lead"]
    yield True, table_of(VEHICLE_COLUMNS, summary.vehicles)
    yield False, table_of(DETAIL_COLUMNS, summary.vehicles, title="vehicles, details")
    yield any(map(_has_process_news, summary.vehicles)), table_of(PROCESS_COLUMNS, summary.vehicles)
    if any(row.own_figures for row in summary.vehicles):
        yield True, table_of([*own_columns(summary)], summary.vehicles, title="own figures")
    if signals := [one for one in STRING_SIGNALS if any(map(one.has_gain, _strings(summary)))]:
        columns = [
            VEHICLE_COLUMNS[0],
            *(one for signal in signals for one in gain_columns(signal)),
        ]
        title = "string stability: gains in L2 / L∞; -: no more than noise"
        yield False, table_of(columns, followers, title=title)
    if any(row.reaction != NO_REACTION or row.overrides for row in followers):
        is_news = any(
            row.reaction.stops
            or row.reaction.blind_m >= 0.05
            or (row.overridden_ratio or 0.0) > OVERRIDDEN_RATIO
            for row in followers
        )
        yield is_news, table_of(REACTION_COLUMNS, followers, title="degradation")
    if summary.links:
        is_news = any(_has_link_news(row, summary.warnings) for row in summary.links)
        yield is_news, _link_table(summary, LINK_COLUMNS, "links: loss and latency")
        yield is_news, _link_table(summary, message_columns(summary.links), "links: messages")
        counts = any(row.false_alarms.counted is not None for row in summary.links)
        is_real = any(row.transport_ms_mean is not None for row in summary.links)
        freshness = (
            *FRESHNESS_COLUMNS,
            *([ALARM_COLUMN] if counts else []),
            *(TRANSPORT_COLUMNS if is_real else []),
        )
        title = "arrivals and age of data: mean / 95th percentile / max"
        yield False, _link_table(summary, freshness, title)
    if summary.events:
        yield True, event_table(summary, MOST_EVENTS if tables == "all" else MOST_NEW_EVENTS)


def _strings(summary: RunSummary) -> Sequence[StringFigures]:
    return [row.string for row in summary.vehicles]


def _has_process_news(row: VehicleSummary) -> bool:
    """Whether poses are missing, messages were refused, or more than 1 % of the ticks late."""
    return bool(
        row.missing_poses or row.rejected_messages or row.late_ticks > LATE_NEWS_RATIO * row.ticks
    )


def _has_link_news(row: LinkSummary, warnings: Sequence[str]) -> bool:
    """Whether a link was cut, altered messages or lacks some, was late, or not as requested."""
    deviates = any(line.startswith(f"{link_name(row)}: ") for line in warnings)
    missed = lost_in_transport(row) or row.unrecorded
    is_late = row.late > LATE_NEWS_RATIO * row.judged
    return bool(deviates or row.false or missed or "cut" in row.dropped or is_late)


def _all_reasons(summary: RunSummary) -> Sequence[str]:
    """All reasons of a failure, if the outcome line does not have them all."""
    reasons = summary.reason.split("; ")
    return [f"failed: {reason}" for reason in reasons] if len(reasons) > 1 else []


def title_of(summary: RunSummary) -> str:
    """Name of the run, changes made to it, its clock and its duration.

    Losses under changed links are counted, instead of the loss that the scenario requests.
    """
    about = summary.identity
    name = about.title or f"{about.scenario}, seed {about.seed}"
    parts = []
    if lost := _changed_loss(summary):
        name = REQUESTED_LOSS.sub("", name)
        parts.append(lost)
    made = [change for change in summary.changes if change.kind not in {"cut", "heal"}]
    parts += [_change_words(change) for change in made[:MOST_CHANGES]]
    if len(made) > MOST_CHANGES:
        parts.append(f"{len(made) - MOST_CHANGES} more changes")
    return ", ".join([name, *parts, f"{about.clock} clock", f"{summary.ran_s:.1f} s"])


def _changed_loss(summary: RunSummary) -> str:
    """Count the messages lost in a run whose links were changed; empty for other runs."""
    cut = sum(row.dropped.get("cut", 0) for row in summary.links)
    if not cut and not any(change.kind == "link" for change in summary.changes):
        return ""
    judged = sum(row.judged for row in summary.links)
    lost = sum(
        count
        for row in summary.links
        for word, count in row.dropped.items()
        if counts_as_loss(word)
    )
    by_cuts = "" if not cut else " by cuts" if cut == lost else f", {cut} by cuts"
    return f"{lost} of {judged} messages lost{by_cuts}"


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


def _link_table(summary: RunSummary, columns: Sequence[Column[LinkSummary]], title: str) -> Table:
    more = len(summary.links) - MOST_LINKS
    return table_of(
        columns,
        worst_rows(summary.links, lambda row: row.loss_ratio, MOST_LINKS),
        title=title,
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
