"""The figures of a run as tables for a person; `summary.json` holds the same for machines."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from scenarios.cli.whole import print_whole
from scenarios.results.channel.account import LinkSummary
from scenarios.results.completeness.holes import hole_lines
from scenarios.results.degradation.reaction import NO_REACTION
from scenarios.results.events.encounters import EventKind
from scenarios.results.events.run_event import road_known
from scenarios.results.summary import RunSummary

if TYPE_CHECKING:  # brings scipy, which a run does without
    from scenarios.studies.gains.results import GainsReport, SampledAt


Row = TypeVar("Row")
MOST_EVENTS = 40
MOST_HOLES = 10
MOST_LINKS = 40
"""So many are printed, of links those that lost most; the summary has them all."""
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


def print_summary(summary: RunSummary, log: Path | None, console: Console) -> None:
    """Print what the vehicles did, the links, the events and holes, and where the log is."""
    console.print(Text(title_of(summary), style="bold"), highlight=False, soft_wrap=True)
    print_whole(vehicle_table(summary), console)
    print_whole(process_table(summary), console)
    if any(row.reaction != NO_REACTION for row in summary.vehicles):
        print_whole(reaction_table(summary), console)
    if summary.links:
        print_whole(link_table(summary), console)
        print_whole(freshness_table(summary), console)
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
    """Name the run with all that was asked of it."""
    about = summary.identity
    name = about.title or f"{about.scenario}, seed {about.seed}"
    return f"{name}, {about.clock} clock, {summary.ran_s:.1f} s"


def vehicle_table(summary: RunSummary) -> Table:
    """One row per vehicle: what is true, then what the vehicle believed of itself."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("vehicle", no_wrap=True)
    for heading in (
        "true\nerror cm\nmax / rms",
        "true\ngap m\nmin",
        "believed\nerror cm\nmax / rms",
        "difference\nof errors\ncm, max",
        "believed\ngap m\nmin",
        "sideways\nm/s², % of\nfriction",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in summary.vehicles:
        table.add_row(
            row.name,
            _pair_cm(row.cross_track_error_m_max, row.cross_track_error_m_rms),
            _figure(row.true_gap_m_min),
            _pair_cm(row.lateral_error_m_max, row.lateral_error_m_rms),
            _figure(row.believed_minus_true_error_m_max, 100.0),
            _figure(row.gap_m_min),
            _grip(row.lateral_acceleration_mps2_max, row.friction_ratio_max),
        )
    return table


def _grip(across: float | None, share: float | None) -> str:
    return "-" if across is None or share is None else f"{across:.1f} / {share * 100:.0f}"


def process_table(summary: RunSummary) -> Table:
    """One row per vehicle: its poses in the log, and how its process did."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("vehicle", no_wrap=True)
    for heading in (
        "poses\nrecorded",
        "poses not\nrecorded",
        "late\nticks",
        "messages\nrefused",
        "memory\nMB",
        "processor\n%",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in summary.vehicles:
        table.add_row(
            row.name,
            str(row.poses),
            str(row.missing_poses),
            str(row.late_ticks),
            str(row.rejected_messages),
            f"{row.memory_bytes_max / 1e6:.0f}" if row.memory_bytes_max else "",
            f"{row.cpu_ratio * 100:.1f}" if row.memory_bytes_max else "",
        )
    return table


def reaction_table(summary: RunSummary) -> Table:
    """One row per follower: what it did about messages that did not come."""
    table = Table(title="when messages failed", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("vehicle", no_wrap=True)
    for heading in (
        "changes\nof mode",
        "recovered",
        "after, s\nmean / max",
        "hazards",
        "stops",
        "blind, m\ndriven / predicted",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in summary.vehicles:
        if row.role == "lead":
            continue
        did = row.reaction
        table.add_row(
            row.name,
            str(did.mode_changes),
            str(did.recoveries),
            f"{_figure(did.recovery_s_mean)} / {_figure(did.recovery_s_max)}",
            str(did.hazards),
            str(did.stops),
            f"{did.blind_m:.1f} / {_figure(did.predicted_blind_m_max)}",
        )
    return table


def event_table(summary: RunSummary) -> Table:
    """One row per event, in order of time."""
    kinds = Counter(event.kind for event in summary.events)
    title = "events: " + ", ".join(
        f"{count} {NAMES[kind][count > 1]}" for kind, count in kinds.items()
    )
    table = Table(title=title, box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("at, s", justify="right", no_wrap=True)
    table.add_column("event", no_wrap=True)
    table.add_column("vehicles")
    table.add_column("figures")
    for event in summary.events[:MOST_EVENTS]:
        table.add_row(
            f"{event.at_s:.2f}",
            NAMES[event.kind][0],
            ", ".join(event.vehicles),
            ", ".join(
                FIGURES[name](value) for name, value in event.figures.items() if name in FIGURES
            ),
        )
    if len(summary.events) > MOST_EVENTS:
        table.add_row("", f"{len(summary.events) - MOST_EVENTS} more", "", "see summary.json")
    return table


def _unrecorded(summary: RunSummary) -> Iterator[str]:
    """Say what is not in the log, and so not in the figures."""
    yield from hole_lines(summary.holes, MOST_HOLES)
    silent = [row for row in summary.vehicles if row.silent_from_s is not None]
    for row in silent:
        yield (
            f"silent: {row.name} from {row.silent_from_s:.2f} s after the start on; it left, died "
            "or was not heard"
        )
    if summary.holes or silent:
        yield "the figures are of what was recorded"


def _figure(value: float | None, scale: float = 1.0) -> str:
    return "-" if value is None else f"{value * scale:.1f}"


def link_table(summary: RunSummary) -> Table:
    """One row per directed link, requested against achieved."""
    table = Table(title="links, requested / achieved", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("link", no_wrap=True)
    for heading in ("loss, %", "in a row", "latency, ms", "sent", "heard", "dropped", "late"):
        table.add_column(heading, justify="right")
    for row in _worst_links(summary):
        table.add_row(
            f"{row.sender} → {row.receiver}"
            + (f", {row.requested.preset}" if row.requested.preset else ""),
            f"{_asked(row.requested_loss_ratio, 100)} / {row.loss_ratio * 100:.1f}",
            f"{_asked(row.requested_burst_messages)} / {_asked(row.burst_messages_mean)}",
            f"{_asked(row.requested_latency_ms_mean)} / {row.latency_ms_mean:.1f}",
            str(row.sent),
            str(row.heard),
            _dropped(row),
            str(row.late),
        )
    _note_more_links(summary, table)
    return table


def worst_rows(rows: Sequence[Row], trouble: Callable[[Row], float], most: int | None) -> list[Row]:
    """The `most` rows with the largest `trouble`, in their own order; all of them for None."""
    worst = sorted(range(len(rows)), key=lambda place: -trouble(rows[place]))[:most]
    return [rows[place] for place in sorted(worst)]


def _worst_links(summary: RunSummary) -> list[LinkSummary]:
    """The links that are printed, in the order of the summary."""
    return worst_rows(summary.links, lambda row: row.loss_ratio, MOST_LINKS)


def _note_more_links(summary: RunSummary, table: Table) -> None:
    if len(summary.links) > MOST_LINKS:
        table.caption = f"{len(summary.links) - MOST_LINKS} more, see summary.json"


def _dropped(row: LinkSummary) -> str:
    """Messages dropped by cause, and what became of others on the way."""
    counts = {**row.dropped, "copies": row.copies, "overtaken": row.reordered}
    counts |= {f"false: {kind}": count for kind, count in row.false.items()}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count) or "0"


def freshness_table(summary: RunSummary) -> Table:
    """One row per directed link: how often something came, and how old it was when it was used."""
    table = Table(title="freshness: mean / 95 % / longest", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("link", no_wrap=True)
    table.add_column("between\narrivals, ms", justify="right", no_wrap=True)
    table.add_column("age at a\ncommand, ms", justify="right", no_wrap=True)
    for limit in SHOWN_AGES_MS:
        table.add_column(f"≤ {limit}\nms, %", justify="right", no_wrap=True)
    counts = any(row.false_alarms.counted is not None for row in summary.links)
    if counts:
        table.add_column("false\nalarms", justify="right", no_wrap=True)
    for row in _worst_links(summary):
        gaps = row.arrival_gap_ms_mean, row.arrival_gap_ms_p95, row.arrival_gap_ms_max
        ages = row.age_ms_mean, row.age_ms_p95, row.age_ms_max
        table.add_row(
            f"{row.sender} → {row.receiver}",
            " / ".join("-" if one is None else f"{one:.0f}" for one in gaps),
            " / ".join("-" if one is None else f"{one:.0f}" for one in ages),
            *(_figure(row.safe_time_ratio.get(limit), 100.0) for limit in SHOWN_AGES_MS),
            *([_count(row.false_alarms.counted)] if counts else []),
        )
    _note_more_links(summary, table)
    return table


def _count(number: int | None) -> str:
    return "-" if number is None else str(number)


def _asked(value: float | None, scale: float = 1.0) -> str:
    return "-" if value is None else f"{value * scale:.3g}"


def _pair_cm(largest: float | None, rms: float | None) -> str:
    return "-" if largest is None or rms is None else f"{largest * 100:.1f} / {rms * 100:.1f}"


def gains_table(report: "GainsReport") -> Table:
    """Margins, propagation and certificate of a set of gains, one speed a row."""
    at_all = report.stabilising_set.inside_at_all_speeds_and_loadings
    title = (
        f"gains {', '.join(f'{value:g}' for value in report.gains)} "
        f"{'stabilise' if at_all else 'do NOT stabilise'} all speeds and loadings"
    )
    table = Table(title=title, box=SIMPLE_HEAD, min_width=len(title))  # on one line
    for heading in (
        "speed\nm/s",
        "slowest pole\n1/s",
        "to the\nboundary",
        "predecessor only\npeak |G|, rad/s",
        "lowest rate, Hz\nIMU, none, control",
    ):
        table.add_column(heading, justify="right")
    rows = zip(report.speeds, report.propagation, report.sampled, strict=True)
    for row, passed_on, sampled in rows:
        peak = passed_on.second_order
        table.add_row(
            f"{row.speed_mps:.1f}",
            f"{row.abscissa_per_s:.2f}",
            f"{row.ball_radius:.3f}",
            f"{peak.norm_ratio:.3f} @ {peak.peak_radps:.2f}" if peak else "unstable",
            _lowest_rates(sampled),
        )
    return table


def _lowest_rates(sampled: "SampledAt") -> str:
    rates = (
        sampled.lowest_imu_rate_hz,
        sampled.lowest_rate_without_imu_hz,
        sampled.lowest_control_rate_hz,
    )
    return ", ".join("-" if rate is None else str(rate) for rate in rates)
