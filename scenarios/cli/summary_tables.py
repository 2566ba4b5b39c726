"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from scenarios.cli.columns import Column, figure, print_whole, table_of, worst_rows
from scenarios.results.channel.link_summary import LinkSummary
from scenarios.results.events.encounters import EventKind
from scenarios.results.events.run_event import RunEvent, road_known
from scenarios.results.holes import hole_lines
from scenarios.results.summary import RunSummary
from scenarios.results.vehicles.reaction import NO_REACTION
from scenarios.results.vehicles.vehicle_figures import VehicleSummary

MOST_EVENTS = 40
MOST_HOLES = 10
MOST_LINKS = 40
"""Printed rows at most, of links those that lost most; the summary has them all."""
SHOWN_AGES_MS = ("200", "500", "1000")
"""Of the ages up to which data may count as fresh."""

NAMES: dict[EventKind, tuple[str, str]] = {
    "collision": ("collision", "collisions"),
    "near_miss": ("near miss", "near misses"),
    "lane_departure": ("lane departure", "lane departures"),
    "path_lost": ("path lost", "paths lost"),
    "slide": ("slide", "slides"),
    "stop": ("stop", "stops"),
    "distrust": ("distrust", "distrusts"),
}
"""Kinds of events, one and several."""
FIGURES: dict[str, Callable[[float], str]] = {
    "closing_speed_mps": "closing at {:.1f} m/s".format,
    "gap_m_min": "gap {:.2f} m".format,
    "time_to_collision_s_min": "{:.1f} s from a collision".format,
    "excess_m_max": "at most {:.2f} m beyond the edge".format,
    "friction_ratio_max": "{:.2f} of the friction".format,
    "slip_rad_max": "slip up to {:.2f} rad".format,
    "known_m": road_known,
    "predicted_blind_m": "{:.1f} m beyond it".format,
    "duration_s": "for {:.1f} s".format,
}
"""Figures of events in words."""


def _pair(largest: float | None, rms: float | None) -> tuple[float, float] | None:
    return None if largest is None or rms is None else (largest, rms)


def _grip(row: VehicleSummary) -> str | None:
    across, share = row.lateral_acceleration_mps2_max, row.friction_ratio_max
    return None if across is None or share is None else f"{across:.1f} / {share * 100:.0f}"


def _figures_of(event: RunEvent) -> str:
    known = ((name, value) for name, value in event.figures.items() if name in FIGURES)
    return ", ".join(FIGURES[name](value) for name, value in known)


def _link_name(row: LinkSummary) -> str:
    return f"{row.sender} → {row.receiver}"


def _dropped(row: LinkSummary) -> str:
    """Counts of dropped messages by cause, of copies, overtaken and false ones."""
    counts = {**row.dropped, "copies": row.copies, "overtaken": row.reordered}
    counts |= {f"false: {kind}": count for kind, count in row.false.items()}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count) or "0"


def _fresh_column(age_ms: str) -> Column[LinkSummary]:
    return Column(f"≤ {age_ms}\nms, %", lambda row: row.safe_time_ratio.get(age_ms), ".1f", 100.0)


VEHICLE_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column(
        "true\nerror cm\nmax / rms",
        lambda row: _pair(row.cross_track_error_m_max, row.cross_track_error_m_rms),
        ".1f",
        100.0,
    ),
    Column("true\ngap m\nmin", lambda row: row.true_gap_m_min, ".1f"),
    Column(
        "believed\nerror cm\nmax / rms",
        lambda row: _pair(row.lateral_error_m_max, row.lateral_error_m_rms),
        ".1f",
        100.0,
    ),
    Column(
        "difference\nof errors\ncm, max",
        lambda row: row.self_estimate_error_m_max,
        ".1f",
        100.0,
    ),
    Column("believed\ngap m\nmin", lambda row: row.estimated_gap_m_min, ".1f"),
    Column("sideways\nm/s², % of\nfriction", _grip),
)
"""True figures of each vehicle, then its self-estimates."""
PROCESS_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("poses\nrecorded", lambda row: row.poses),
    Column("poses not\nrecorded", lambda row: row.missing_poses),
    Column("late\nticks", lambda row: row.late_ticks),
    Column("messages\nrefused", lambda row: row.rejected_messages),
    Column(
        "memory\nMB",
        lambda row: f"{row.memory_bytes_max / 1e6:.0f}" if row.memory_bytes_max else "",
    ),
    Column(
        "processor\n%", lambda row: f"{row.cpu_ratio * 100:.1f}" if row.memory_bytes_max else ""
    ),
)
"""Poses of each vehicle in the log, and figures of its process."""
REACTION_COLUMNS: Sequence[Column[VehicleSummary]] = (
    Column("vehicle", lambda row: row.name, left=True),
    Column("changes\nof mode", lambda row: row.reaction.mode_changes),
    Column("recovered", lambda row: row.reaction.recoveries),
    Column(
        "after, s\nmean / max",
        lambda row: (row.reaction.recovery_s_mean, row.reaction.recovery_s_max),
        ".1f",
    ),
    Column("hazards", lambda row: row.reaction.hazards),
    Column("stops", lambda row: row.reaction.stops),
    Column(
        "blind, m\ndriven / predicted",
        lambda row: (row.reaction.blind_m, row.reaction.predicted_blind_m_max),
        ".1f",
    ),
)
"""Reaction of each follower to missing messages."""
EVENT_COLUMNS: Sequence[Column[RunEvent]] = (
    Column("at, s", lambda event: event.at_s, ".2f"),
    Column("event", lambda event: NAMES[event.kind][0], left=True),
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
        "loss, %",
        lambda row: f"{figure(row.requested_loss_ratio, '.3g', 100)} / {row.loss_ratio * 100:.1f}",
        wraps=True,
    ),
    Column(
        "in a row",
        lambda row: (row.requested_burst_messages, row.burst_messages_mean),
        ".3g",
        wraps=True,
    ),
    Column(
        "latency, ms",
        lambda row: f"{figure(row.requested_latency_ms_mean, '.3g')} / {row.latency_ms_mean:.1f}",
        wraps=True,
    ),
    Column("sent", lambda row: row.sent, wraps=True),
    Column("heard", lambda row: row.delivered, wraps=True),
    Column("dropped", _dropped, wraps=True),
    Column("late", lambda row: row.late, wraps=True),
)
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
ALARM_COLUMN: Column[LinkSummary] = Column("false\nalarms", lambda row: row.false_alarms.counted)


def print_summary(summary: RunSummary, log: Path | None, console: Console) -> None:
    """Print tables of vehicles, links and events, then holes, warnings and the log's path."""
    console.print(Text(title_of(summary), style="bold"), highlight=False, soft_wrap=True)
    print_whole(table_of(VEHICLE_COLUMNS, summary.vehicles), console)
    print_whole(table_of(PROCESS_COLUMNS, summary.vehicles), console)
    if any(row.reaction != NO_REACTION for row in summary.vehicles):
        followers = [row for row in summary.vehicles if row.role != "lead"]
        print_whole(table_of(REACTION_COLUMNS, followers, title="when messages failed"), console)
    if summary.links:
        counts = any(row.false_alarms.counted is not None for row in summary.links)
        freshness = (*FRESHNESS_COLUMNS, *([ALARM_COLUMN] if counts else []))
        print_whole(_link_table(summary, LINK_COLUMNS, "links, requested / achieved"), console)
        print_whole(_link_table(summary, freshness, "freshness: mean / 95 % / longest"), console)
    if summary.events:
        print_whole(event_table(summary), console)
    for line in (*_unrecorded(summary), *summary.warnings):
        console.print(line, highlight=False, markup=False, emoji=False, soft_wrap=True)
    if summary.reason:
        word = "ended early" if summary.ran_s < summary.duration_s else "failed"
        console.print(
            f"[bold red]{word}:[/] {escape(summary.reason)}", highlight=False, soft_wrap=True
        )
    if log is not None:
        console.print(f"log: {log}", highlight=False, markup=False, emoji=False, soft_wrap=True)


def title_of(summary: RunSummary) -> str:
    about = summary.identity
    name = about.title or f"{about.scenario}, seed {about.seed}"
    return f"{name}, {about.clock} clock, {summary.ran_s:.1f} s"


def event_table(summary: RunSummary) -> Table:
    kinds = Counter(event.kind for event in summary.events)
    title = "events: " + ", ".join(
        f"{count} {NAMES[kind][count > 1]}" for kind, count in kinds.items()
    )
    table = table_of(EVENT_COLUMNS, summary.events[:MOST_EVENTS], title=title)
    if len(summary.events) > MOST_EVENTS:
        table.add_row("", f"{len(summary.events) - MOST_EVENTS} more", "", "see summary.json")
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
    """Describe what is missing in the log, and so in the figures."""
    yield from hole_lines(summary.holes, MOST_HOLES)
    silent = [row for row in summary.vehicles if row.silent_from_s is not None]
    for row in silent:
        yield (
            f"silent: {row.name} from {row.silent_from_s:.2f} s after the start on; it left, died "
            "or was not heard"
        )
    if summary.holes or silent:
        yield "the figures are of what was recorded"
