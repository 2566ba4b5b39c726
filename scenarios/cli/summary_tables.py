"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from scenarios.cli.common_options import Tables
from scenarios.cli.output import Column, figure, print_whole, table_of, worst_rows
from scenarios.results.events import EventKind
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
from scenarios.results.links import LinkSummary, lost_in_transport
from scenarios.results.outcome import with_outcome_line
from scenarios.results.reaction import NO_REACTION
from scenarios.results.record import hole_lines
from scenarios.results.run_event import RunEvent, road_known
from scenarios.results.string_figures import STRING_SIGNALS, StringFigures, StringSignal
from scenarios.results.summary import RunChange, RunSummary
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
SHOWN_AGES_MS = ("200", "500", "1000")
"""Of the ages up to which data may count as fresh."""

NAMES: dict[EventKind, tuple[str, str]] = {
    "collision": ("collision", "collisions"),
    "near_miss": ("near miss", "near misses"),
    "lane_departure": ("lane departure", "lane departures"),
    "falls_behind": ("falls behind", "fall behind"),
    "stranded": ("stranded", "stranded"),
    "overspeed": ("overspeed", "overspeeds"),
    "hard_braking": ("hard braking", "hard brakings"),
    "overridden": ("overridden", "overridden"),
    "own": ("own event", "own events"),
    "path_lost": ("path lost", "paths lost"),
    "slide": ("slide", "slides"),
    "stop": ("emergency stop", "emergency stops"),
    "distrust": ("distrust", "distrusts"),
}
"""Kinds of events, one and several."""
FIGURES: dict[str, Callable[[float], str]] = {
    "closing_speed_mps": "closing at {:.1f} m/s".format,
    "gap_m_min": "gap {:.2f} m".format,
    "time_to_collision_s_min": "{:.1f} s from a collision".format,
    "excess_m_max": "up to {:.2f} m outside the lane".format,
    "friction_ratio_max": "{:.2f} of the friction".format,
    "slip_rad_max": "slip up to {:.2f} rad".format,
    "known_m": road_known,
    "predicted_blind_m": "predicted blind distance {:.1f} m".format,
    "gap_excess_m_max": "up to {:.1f} m".format,
    "speed_excess_mps_max": "by up to {:.1f} m/s".format,
    "braking_mps2_max": "{:.1f} m/s²".format,
    "overridden_ratio": "{:.2f} of the time".format,
    "duration_s": "lasted {:.1f} s".format,
}
"""Figures of events in words."""


def _pair(first: float | None, second: float | None) -> tuple[float | None, ...] | None:
    return None if first is None else (first, second)


def _figures_of(event: RunEvent) -> str:
    known = ((name, value) for name, value in event.figures.items() if name in FIGURES)
    return "; ".join(FIGURES[name](value) for name, value in known)


def _link_name(row: LinkSummary) -> str:
    return f"{row.sender} → {row.receiver}"


def _dropped(row: LinkSummary) -> str:
    return _counts(row.dropped) or "0"


def _not_arrived(row: LinkSummary) -> str:
    causes = {word.replace("_", " "): count for word, count in row.not_arrived.items()}
    return _counts(causes) or "0"


def _altered(row: LinkSummary) -> str:
    false = {f"false: {kind}": count for kind, count in row.false.items()}
    return _counts({"copies": row.copies, **false}) or "0"


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count)


def _fresh_column(age_ms: str) -> Column[LinkSummary]:
    return Column(f"≤ {age_ms}\nms, %", lambda row: row.safe_time_ratio.get(age_ms), ".1f", 100.0)


VEHICLE_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column(
        "true\nerror, cm\nmax / rms",
        lambda row: _pair(row.cross_track_error_m_max, row.cross_track_error_m_rms),
        ".1f",
        100.0,
    ),
    Column("road\nerror\nmax, cm", lambda row: row.road_error_m_max, ".1f", 100.0),
    Column(
        "true\ngap, m\nmin / max",
        lambda row: _pair(row.true_gap_m_min, row.true_gap_m_max),
        ".1f",
    ),
    Column(
        "estimated\nerror, cm\nmax / rms",
        lambda row: _pair(row.lateral_error_m_max, row.lateral_error_m_rms),
        ".1f",
        100.0,
    ),
    Column("estimated\ngap, m\nmin", lambda row: row.estimated_gap_m_min, ".1f"),
    Column("friction\nused, %\nmax", lambda row: row.friction_ratio_max, ".0f", 100.0),
)
"""True figures of each vehicle next to its estimates."""
DETAIL_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("largest\nerror\nat, s", lambda row: row.cross_track_error_max_at_s, ".2f"),
    Column("least\ngap\nat, s", lambda row: row.true_gap_min_at_s, ".2f"),
    Column(
        "estimate\nminus true\nerror, cm",
        lambda row: row.self_estimate_error_m_max,
        ".1f",
        100.0,
    ),
    Column("own\n3σ\ncm", lambda row: row.lateral_deviation_m_max, ".1f", 300.0),
    Column(
        "lateral\nacceleration\nmax, m/s²", lambda row: row.lateral_acceleration_mps2_max, ".1f"
    ),
    Column("braking\nheld\nmin, m/s²", lambda row: row.held_braking_mps2_min, ".1f"),
    Column("distance\nm", lambda row: row.distance_m, ".0f"),
)
PROCESS_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("poses\nrecorded", lambda row: row.poses),
    Column("poses not\nrecorded", lambda row: row.missing_poses),
    Column("late\nticks", lambda row: row.late_ticks),
    Column("messages\nrefused", lambda row: row.rejected_messages),
    Column(
        "memory\nMB",
        lambda row: row.memory_bytes_max / 1e6 if row.memory_bytes_max else None,
        ".0f",
    ),
    Column(
        "processor\n%", lambda row: row.cpu_ratio if row.memory_bytes_max else None, ".1f", 100.0
    ),
)
"""Poses of each vehicle in the log, and figures of its process."""
REACTION_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("mode\nchanges", lambda row: row.reaction.mode_changes),
    Column("recoveries", lambda row: row.reaction.recoveries),
    Column(
        "time to\nrecover, s\nmean / max",
        lambda row: (row.reaction.recovery_s_mean, row.reaction.recovery_s_max),
        ".1f",
    ),
    Column("over-\nridden\n%", lambda row: row.overridden_ratio, ".0f", 100.0),
    Column("stops\nbegun", lambda row: row.reaction.stops),
    Column(
        "blind distance, m\ndriven / predicted\nwhen braking began",
        lambda row: (row.reaction.blind_m, row.reaction.predicted_blind_m_max),
        ".1f",
    ),
)
"""Reaction of each follower to missing messages."""
EVENT_COLUMNS: Sequence[Column[RunEvent]] = (
    Column("at, s", lambda event: event.period.removesuffix(" s")),
    Column("event", lambda event: event.name or NAMES[event.kind][0], left=True),
    Column("vehicles", lambda event: ", ".join(event.vehicles), left=True, wraps=True),
    Column("figures", _figures_of, left=True, wraps=True),
)
LINK_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column(
        "link",
        lambda row: _link_name(row) + (f", {row.requested.preset}" if row.requested.preset else ""),
        left=True,
    ),
    Column(
        "loss, %\nrequested / achieved",
        lambda row: f"{figure(row.requested_loss_ratio, '.3g', 100)} / {row.loss_ratio * 100:.1f}",
        wraps=True,
    ),
    Column(
        "mean burst, messages\nrequested / achieved",
        lambda row: (row.requested_burst_messages, row.burst_messages_mean),
        ".3g",
        wraps=True,
    ),
    Column(
        "latency, ms\nrequested / achieved",
        lambda row: (
            f"{figure(row.requested_latency_ms_mean, '.3g')} / {figure(row.latency_ms_mean, '.1f')}"
        ),
        wraps=True,
    ),
)
MESSAGE_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column("link", _link_name, left=True),
    Column("sent", lambda row: row.sent, wraps=True),
    Column("delivered", lambda row: row.delivered, wraps=True),
    Column("late", lambda row: row.late, wraps=True),
    Column("reordered", lambda row: row.reordered, wraps=True),
    Column("dropped", _dropped, wraps=True),
    Column("not arrived", _not_arrived, wraps=True),
    Column("in flight", lambda row: row.in_flight, wraps=True),
)
"""Each sent message is delivered, dropped, not arrived, in flight at the end or unrecorded."""
FRESHNESS_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column("link", _link_name, left=True),
    Column(
        "between\narrivals, ms",
        lambda row: (row.arrival_gap_ms_mean, row.arrival_gap_ms_p95, row.arrival_gap_ms_max),
        ".0f",
    ),
    Column(
        "age at a\ncommand, ms",
        lambda row: (row.age_ms_mean, row.age_ms_p95, row.age_ms_max),
        ".0f",
    ),
    *map(_fresh_column, SHOWN_AGES_MS),
)
"""How often messages arrived over each link, and how old data was when it was used."""
TRANSPORT_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column(
        "real\ntransport, ms",
        lambda row: (row.transport_ms_mean, row.transport_ms_p95, row.transport_ms_max),
        ".1f",
    ),
    Column("above the\nfloor, %", lambda row: row.transport_above_floor_ratio, ".1f", 100.0),
)
UNRECORDED_COLUMN: Column[LinkSummary] = Column(
    "unrecorded", lambda row: row.unrecorded, wraps=True
)
ALTERED_COLUMN: Column[LinkSummary] = Column("copied or\naltered", _altered, wraps=True)
ALARM_COLUMN: Column[LinkSummary] = Column(
    "false\nlosses of\nsource", lambda row: row.false_alarms.counted
)


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


def _own_columns(summary: RunSummary) -> Iterator[Column[VehicleSummary]]:
    yield VEHICLE_COLUMNS[0]
    for name in dict.fromkeys(name for row in summary.vehicles for name in row.own_figures):
        yield Column(name, partial(_own_figure, name), ".4g")


def _own_figure(name: str, row: VehicleSummary) -> float | None:
    return row.own_figures.get(name)


def _tables(summary: RunSummary, tables: Tables) -> Iterator[tuple[bool, Table]]:
    """Yield the tables of a summary, each with whether it carries news."""
    followers = [row for row in summary.vehicles if row.role != "lead"]
    yield True, table_of(VEHICLE_COLUMNS, summary.vehicles)
    yield False, table_of(DETAIL_COLUMNS, summary.vehicles, title="vehicles, details")
    yield any(map(_has_process_news, summary.vehicles)), table_of(PROCESS_COLUMNS, summary.vehicles)
    if any(row.own_figures for row in summary.vehicles):
        yield True, table_of([*_own_columns(summary)], summary.vehicles, title="own figures")
    if signals := [one for one in STRING_SIGNALS if any(map(one.has_gain, _strings(summary)))]:
        columns = [
            VEHICLE_COLUMNS[0],
            *(one for signal in signals for one in _gain_columns(signal)),
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
        yield is_news, _link_table(summary, _message_columns(summary.links), "links: messages")
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


def _gain_columns(signal: StringSignal) -> Iterator[Column[VehicleSummary]]:
    """Yield the gains of a signal from the vehicle ahead, and from the head of the string."""
    yield Column(f"{signal.name}\ngain", lambda row: signal.gains(row.string), ".2f")
    head = "lead" if signal.head == "lead" else "first\nfollower"
    yield Column(f"from\n{head}", lambda row: signal.gains_from_head(row.string), ".2f")


def _message_columns(rows: Sequence[LinkSummary]) -> Sequence[Column[LinkSummary]]:
    unrecorded = [UNRECORDED_COLUMN] if any(row.unrecorded for row in rows) else []
    altered = [ALTERED_COLUMN] if any(row.copies or row.false for row in rows) else []
    return *MESSAGE_COLUMNS, *unrecorded, *altered


def _has_process_news(row: VehicleSummary) -> bool:
    """Whether poses are missing, messages were refused, or more than 1 % of the ticks late."""
    return bool(
        row.missing_poses or row.rejected_messages or row.late_ticks > LATE_NEWS_RATIO * row.ticks
    )


def _has_link_news(row: LinkSummary, warnings: Sequence[str]) -> bool:
    """Whether a link was cut, altered messages or lacks some, was late, or not as requested."""
    deviates = any(line.startswith(f"{_link_name(row)}: ") for line in warnings)
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
        f"{count} {NAMES[kind][count > 1]}" for kind, count in kinds.items()
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
