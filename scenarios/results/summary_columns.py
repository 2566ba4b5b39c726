"""Columns of the tables of a summary, for the terminal and for the HTML report."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from scenarios.results.events import EventKind
from scenarios.results.links import LinkSummary, lost_in_transport
from scenarios.results.reaction import NO_REACTION
from scenarios.results.run_event import RunEvent, road_known
from scenarios.results.string_figures import STRING_SIGNALS, StringSignal
from scenarios.results.summary import RunSummary
from scenarios.results.traffic import OVERRIDDEN_RATIO
from scenarios.results.vehicle_figures import VehicleSummary

if TYPE_CHECKING:
    from rich.text import Text

    Cell = float | str | Text | tuple[float | None, ...] | None

Row = TypeVar("Row")


@dataclass(frozen=True, slots=True)
class Column(Generic[Row]):
    """A column: its heading, with the unit, and the value of a row.

    `of` is a function of the row, or the name of its attribute, or several names. A number is
    printed as `format`, `scale` times as large, and None as "-"; several numbers are printed with
    slashes between them. Figures are aligned right and never wrap.
    """

    heading: str
    of: "Callable[[Row], Cell] | str | tuple[str, ...]"
    format: str = ""
    scale: float = 1
    left: bool = False
    wraps: bool = False
    max_width: int | None = None
    optional: bool = False
    """Whether the column is left out if all its cells are empty or 0."""

    def value(self, row: Row) -> "Cell":
        if callable(self.of):
            return self.of(row)
        names = (self.of,) if isinstance(self.of, str) else self.of
        value: Cell = attrgetter(*names)(row)
        return value

    def is_empty(self, rows: Iterable[Row]) -> bool:
        return all(set(str(self.cell(row)).split(" / ")) <= {"-", "0"} for row in rows)

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

LATE_NEWS_RATIO = 0.01
"""Share of late ticks or messages from which a table carries news."""
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


def _pair(first: str, second: str) -> "Callable[[VehicleSummary], Cell]":
    """Two metrics of a vehicle, or None if there is no first one."""
    return lambda row: None if getattr(row, first) is None else attrgetter(first, second)(row)


def _figures_of(event: RunEvent) -> str:
    known = ((name, value) for name, value in event.figures.items() if name in EVENT_FIGURES)
    return "; ".join(EVENT_FIGURES[name](value) for name, value in known)


def link_name(row: LinkSummary) -> str:
    return f"{row.sender} → {row.receiver}"


def _altered(row: LinkSummary) -> str:
    return _counts({"copies": row.copies, **{f"false: {kind}": n for kind, n in row.false.items()}})


def _counts(counts: Mapping[str, int]) -> str:
    """Counts above 0 with their kinds; "0" without any."""
    return ", ".join(f"{count} {kind}" for kind, count in counts.items() if count) or "0"


def _fresh_column(age_ms: str) -> Column[LinkSummary]:
    return Column(f"≤ {age_ms}\nms, %", lambda row: row.safe_time_ratio.get(age_ms), ".1f", 100.0)


VEHICLE: Column[VehicleSummary] = Column("vehicle", "name", left=True)
VEHICLE_COLUMNS: Sequence[Column[VehicleSummary]] = (
    VEHICLE,
    Column(
        "true\nerror, cm\nmax / rms",
        _pair("cross_track_error_m_max", "cross_track_error_m_rms"),
        ".1f",
        100.0,
    ),
    Column("road\nerror\nmax, cm", "road_error_m_max", ".1f", 100.0),
    Column("true\ngap, m\nmin / max", _pair("true_gap_m_min", "true_gap_m_max"), ".1f"),
    Column(
        "estimated\nerror, cm\nmax / rms",
        _pair("lateral_error_m_max", "lateral_error_m_rms"),
        ".1f",
        100.0,
    ),
    Column("estimated\ngap, m\nmin", "estimated_gap_m_min", ".1f"),
    Column("friction\nused, %\nmax", "friction_ratio_max", ".0f", 100.0),
)
"""True figures of each vehicle next to its estimates."""
DETAIL_COLUMNS: Sequence[Column[VehicleSummary]] = (
    VEHICLE,
    Column("largest\nerror\nat, s", "cross_track_error_max_at_s", ".2f"),
    Column("least\ngap\nat, s", "true_gap_min_at_s", ".2f"),
    Column("estimate\nminus true\nerror, cm", "self_estimate_error_m_max", ".1f", 100.0),
    Column("own\n3σ\ncm", "lateral_deviation_m_max", ".1f", 300.0),
    Column("lateral\nacceleration\nmax, m/s²", "lateral_acceleration_mps2_max", ".1f"),
    Column("braking\nheld\nmin, m/s²", "held_braking_mps2_min", ".1f"),
    Column("distance\nm", "distance_m", ".0f"),
)
PROCESS_COLUMNS: Sequence[Column[VehicleSummary]] = (
    VEHICLE,
    Column("poses\nrecorded", "poses"),
    Column("poses not\nrecorded", "missing_poses"),
    Column("late\nticks", "late_ticks"),
    Column("messages\nrefused", "rejected_messages"),
    Column("memory\nMB", lambda row: row.memory_bytes_max or None, ".0f", 1e-6),
    Column(
        "processor\n%", lambda row: row.cpu_ratio if row.memory_bytes_max else None, ".1f", 100.0
    ),
)
"""Poses of each vehicle in the log, and figures of its process."""
REACTION_COLUMNS: Sequence[Column[VehicleSummary]] = (
    VEHICLE,
    Column("mode\nchanges", "reaction.mode_changes"),
    Column("recoveries", "reaction.recoveries"),
    Column(
        "time to\nrecover, s\nmean / max",
        ("reaction.recovery_s_mean", "reaction.recovery_s_max"),
        ".1f",
    ),
    Column("over-\nridden\n%", "overridden_ratio", ".0f", 100.0),
    Column("stops\nbegun", "reaction.stops"),
    Column(
        "blind distance, m\ndriven / predicted\nwhen braking began",
        ("reaction.blind_m", "reaction.predicted_blind_m_max"),
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
        lambda row: (
            f"{figure(row.requested_latency_ms_mean, '.3g')} / {figure(row.latency_ms_mean, '.1f')}"
        ),
        wraps=True,
    ),
)
MESSAGE_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column("link", link_name, left=True),
    Column("sent", "sent", wraps=True),
    Column("delivered", "delivered", wraps=True),
    Column("late", "late", wraps=True),
    Column("reordered", "reordered", wraps=True),
    Column("dropped", lambda row: _counts(row.dropped), wraps=True),
    Column("not arrived", lambda row: _counts(row.not_arrived).replace("_", " "), wraps=True),
    Column("in flight", "in_flight", wraps=True),
    Column("unrecorded", "unrecorded", wraps=True, optional=True),
    Column("copied or\naltered", _altered, wraps=True, optional=True),
)
"""Each sent message is delivered, dropped, not arrived, in flight at the end or unrecorded."""
FRESHNESS_COLUMNS: Sequence[Column[LinkSummary]] = (
    Column("link", link_name, left=True),
    Column(
        "between\narrivals, ms",
        ("arrival_gap_ms_mean", "arrival_gap_ms_p95", "arrival_gap_ms_max"),
        ".0f",
    ),
    Column("age at a\ncommand, ms", ("age_ms_mean", "age_ms_p95", "age_ms_max"), ".0f"),
    *map(_fresh_column, SHOWN_AGES_MS),
    Column("false\nlosses of\nsource", "false_alarms.counted", optional=True),
    Column(
        "real\ntransport, ms",
        ("transport_ms_mean", "transport_ms_p95", "transport_ms_max"),
        ".1f",
        optional=True,
    ),
    Column("above the\nfloor, %", "transport_above_floor_ratio", ".1f", 100.0, optional=True),
)
"""How often messages arrived over each link, and how old data was when it was used."""


def _gain_columns(signal: StringSignal) -> Iterator[Column[VehicleSummary]]:
    """Yield the gains of a signal from the vehicle ahead, and from the head of the string."""
    head = "lead" if signal.head == "lead" else "first\nfollower"
    ahead, first = signal.gains, signal.gains_from_head
    yield Column(f"{signal.name}\ngain", lambda row: ahead(row.string), ".2f", optional=True)
    yield Column(f"from\n{head}", lambda row: first(row.string), ".2f", optional=True)


def _own_column(name: str) -> Column[VehicleSummary]:
    return Column(name, lambda row: row.own_figures.get(name), ".4g")


# ---- The tables of a summary


@dataclass(frozen=True, slots=True)
class SummaryTable:
    """A table of metrics; `is_news` states whether it has something unusual."""

    title: str
    all_columns: Sequence[Column[Any]]
    rows: Sequence[Any]
    is_news: bool = True

    @property
    def columns(self) -> list[Column[Any]]:
        """Columns without the optional ones that are empty."""
        return [
            column
            for column in self.all_columns
            if not (column.optional and column.is_empty(self.rows))
        ]


def tables_of(summary: RunSummary) -> Iterator[SummaryTable]:
    """Yield the tables of vehicles and links that have rows and more columns than their names."""
    vehicles, links = summary.vehicles, summary.links
    followers = [row for row in vehicles if row.role != "lead"]
    degraded = any(row.reaction != NO_REACTION or row.overrides for row in followers)
    link_news = any(has_link_news(row, summary.warnings) for row in links)
    gains = [column for signal in STRING_SIGNALS for column in _gain_columns(signal)]
    own = dict.fromkeys(name for row in vehicles for name in row.own_figures)
    title = "string stability: gains in L2 / L∞; -: no more than noise"
    arrivals = "arrivals and age of data: mean / 95th percentile / max"
    process_news = any(map(_has_process_news, vehicles))
    for table in (
        SummaryTable("vehicles", VEHICLE_COLUMNS, vehicles),
        SummaryTable("vehicles, details", DETAIL_COLUMNS, vehicles, is_news=False),
        SummaryTable("processes", PROCESS_COLUMNS, vehicles, process_news),
        SummaryTable("own figures", [VEHICLE, *map(_own_column, own)], vehicles),
        SummaryTable(title, [VEHICLE, *gains], followers, is_news=False),
        SummaryTable(
            "degradation",
            REACTION_COLUMNS,
            followers if degraded else (),
            any(map(_has_reaction_news, followers)),
        ),
        SummaryTable("links: loss and latency", LINK_COLUMNS, links, link_news),
        SummaryTable("links: messages", MESSAGE_COLUMNS, links, link_news),
        SummaryTable(arrivals, FRESHNESS_COLUMNS, links, is_news=False),
    ):
        if table.rows and len(table.columns) > 1:
            yield table


def _has_process_news(row: VehicleSummary) -> bool:
    """Whether poses are missing, messages were refused, or more than 1 % of the ticks late."""
    return bool(
        row.missing_poses or row.rejected_messages or row.late_ticks > LATE_NEWS_RATIO * row.ticks
    )


def _has_reaction_news(row: VehicleSummary) -> bool:
    overridden = (row.overridden_ratio or 0.0) > OVERRIDDEN_RATIO
    return bool(row.reaction.stops or row.reaction.blind_m >= 0.05 or overridden)


def has_link_news(row: LinkSummary, warnings: Sequence[str]) -> bool:
    """Whether a link was cut, altered messages or lacks some, was late, or not as requested."""
    deviates = any(line.startswith(f"{link_name(row)}: ") for line in warnings)
    missed = lost_in_transport(row) or row.unrecorded
    is_late = row.late > LATE_NEWS_RATIO * row.judged
    return bool(deviates or row.false or missed or "cut" in row.dropped or is_late)
