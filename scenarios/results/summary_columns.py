"""Columns of the tables of a summary, for the terminal and for the HTML report."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Generic, TypeVar

from scenarios.results.encounters import EventKind
from scenarios.results.link_summary import LinkSummary
from scenarios.results.run_event import RunEvent, road_known
from scenarios.results.string_figures import StringSignal
from scenarios.results.summary import RunSummary
from scenarios.results.vehicle_figures import VehicleSummary

if TYPE_CHECKING:
    from rich.text import Text

Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class Column(Generic[Row]):
    """A column: its heading, with the unit, and the value of a row.

    A number is printed as `format`, `scale` times as large, and None as "-"; several numbers are
    printed with slashes between them. Figures are aligned right and never wrap.
    """

    heading: str
    value: "Callable[[Row], float | str | Text | tuple[float | None, ...] | None]"
    format: str = ""
    scale: float = 1
    left: bool = False
    wraps: bool = False
    max_width: int | None = None

    def cell(self, row: Row) -> "str | Text":
        value = self.value(row)
        if value is None or isinstance(value, int | float):
            return figure(value, self.format, self.scale)
        if isinstance(value, tuple):
            return " / ".join(figure(number, self.format, self.scale) for number in value)
        return value


def figure(value: float | None, form: str = "", scale: float = 1) -> str:
    """Format a number, `scale` times as large; "-" if there is none."""
    return "-" if value is None else format(value * scale, form)


# ---- Vehicles, links and events of a summary

SHOWN_AGES_MS = ("200", "500", "1000")
"""Of the ages up to which data may count as fresh."""

EVENT_NAMES: dict[EventKind, tuple[str, str]] = {
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
EVENT_FIGURES: dict[str, Callable[[float], str]] = {
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
    known = ((name, value) for name, value in event.figures.items() if name in EVENT_FIGURES)
    return "; ".join(EVENT_FIGURES[name](value) for name, value in known)


def link_name(row: LinkSummary) -> str:
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
    Column("event", lambda event: event.name or EVENT_NAMES[event.kind][0], left=True),
    Column("vehicles", lambda event: ", ".join(event.vehicles), left=True, wraps=True),
    Column("figures", _figures_of, left=True, wraps=True),
)
LINK_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column(
        "link",
        lambda row: link_name(row) + (f", {row.requested.preset}" if row.requested.preset else ""),
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
        lambda row: f"{figure(row.requested_latency_ms_mean, '.3g')} / {row.latency_ms_mean:.1f}",
        wraps=True,
    ),
)
MESSAGE_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column("link", link_name, left=True),
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
    Column("link", link_name, left=True),
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


def gain_columns(signal: StringSignal) -> Iterator[Column[VehicleSummary]]:
    """Yield the gains of a signal from the vehicle ahead, and from the head of the string."""
    yield Column(f"{signal.name}\ngain", lambda row: signal.gains(row.string), ".2f")
    head = "lead" if signal.head == "lead" else "first\nfollower"
    yield Column(f"from\n{head}", lambda row: signal.gains_from_head(row.string), ".2f")


def message_columns(rows: Sequence[LinkSummary]) -> Sequence[Column[LinkSummary]]:
    unrecorded = [UNRECORDED_COLUMN] if any(row.unrecorded for row in rows) else []
    altered = [ALTERED_COLUMN] if any(row.copies or row.false for row in rows) else []
    return *MESSAGE_COLUMNS, *unrecorded, *altered


def own_columns(summary: RunSummary) -> Iterator[Column[VehicleSummary]]:
    yield VEHICLE_COLUMNS[0]
    for name in dict.fromkeys(name for row in summary.vehicles for name in row.own_figures):
        yield Column(name, partial(_own_figure, name), ".4g")


def _own_figure(name: str, row: VehicleSummary) -> float | None:
    return row.own_figures.get(name)
