"""Events of a run: spans of time in which a condition holds, as functions of the run's tables."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.results.tables import QUIET_NS, RunTables, once, spans
from scenarios.results.true_motion import (
    Gaps,
    body_sizes,
    corner_offsets,
    distances,
    gaps,
)
from transport.columns import Array, Columns, Flags, Floats, Integers
from vehicles.car.tyres import SLIDING_SHARE
from vehicles.messages import statuses_in
from vehicles.schedule import SECOND, nanoseconds

# fmt: off
EventKind = Literal[
    "collision", "distrust", "falls_behind", "hard_braking", "lane_departure", "near_miss",
    "overridden", "overspeed", "own", "path_lost", "slide", "stop", "stranded",
]
# fmt: on
PARTED_M = 0.2
"""Distance at which collided bodies have separated, so that a grazing contact is one collision."""
REACH_MARGIN_M = 2.0
"""Distance of bodies, in addition to their own size, up to which they are compared."""
LOST_MODES = ("coast", "stop", "straight")
"""Modes of a follower that has no trajectory from what it received, unless it knows the road."""
UNRECORDED_NS = SECOND // 2
"""Longest time between two tracking messages of one event; the slowest control runs at 5 Hz."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event that began at an instant; its figures have unit suffixes.

    `vehicles` are those involved, in the order of the convoy. `place` (east, north, m) is where it
    began; `name` is that of an event of the user.
    """

    kind: EventKind
    vehicles: tuple[str, ...]
    at_ns: int
    figures: Mapping[str, float] = field(default_factory=dict)
    place: tuple[float, float] = (0.0, 0.0)
    name: str = ""

    @property
    def key(self) -> tuple[object, ...]:
        """Identity of the event, whose figures may still grow."""
        return self.kind, self.vehicles, self.at_ns, self.name


# ---- Spans of time in which a condition holds


def begins(holds: Flags) -> Flags:
    """Whether a condition begins to hold in each row."""
    first: Flags = holds & ~np.append(False, holds[:-1])
    return first


def seconds_between(at: Integers, first: int, last: int) -> float:
    return int(at[last] - at[first]) / SECOND


def is_one_of(texts: NDArray[Any], *words: str) -> Flags:
    """Whether each text of a column is one of `words`."""
    found = np.zeros(len(texts), bool)
    for word in words:
        found |= texts == word
    return found


def place_at(truth: Columns, at: int) -> tuple[float, float]:
    """Position (east, north, m) of a vehicle at its last true pose up to an instant (ns)."""
    row = int(np.searchsorted(truth.at_ns, at, side="right")) - 1
    return (float(truth["east_m"][row]), float(truth["north_m"][row])) if row >= 0 else (0.0, 0.0)


# ---- Encounters of two vehicles


def encounters(run: RunTables) -> Iterator[Event]:
    """Yield collisions of any two vehicles, and near misses of neighbours."""
    rules = run.scenario.tables.events
    for first, second in combinations(run.names, 2):
        is_pair = run.ahead(second) == first
        if is_pair:
            apart = gaps(run, second)
        elif _may_meet(run, first, second):
            apart = distances(run, first, second, _reach(run))
        else:
            continue
        yield from _collisions(run, (first, second), apart)
        if is_pair:
            yield from _near_misses(
                run, (first, second), apart, rules.near_miss_gap_m, rules.near_miss_time_s
            )


@once
def _reach(run: RunTables) -> float:
    sizes = body_sizes(run).values()
    return max(float(np.hypot(size.length, size.width)) for size in sizes) + REACH_MARGIN_M


@once
def _extent(run: RunTables, name: str) -> NDArray[np.float64] | None:
    """Lowest and highest coordinates (2, 2) of a vehicle; None without true poses."""
    truth = run.table(name, "truth")
    if not len(truth):
        return None
    places = np.array([truth["east_m"], truth["north_m"]])
    return np.array([places.min(axis=1), places.max(axis=1)])


def _may_meet(run: RunTables, first: str, second: str) -> bool:
    one, other, reach = _extent(run, first), _extent(run, second), _reach(run)
    if one is None or other is None:
        return False
    return bool((one[0] < other[1] + reach).all() and (other[0] < one[1] + reach).all())


def _collisions(run: RunTables, pair: tuple[str, str], apart: Gaps) -> Iterator[Event]:
    """Yield contacts; a new one needs bodies that have parted."""
    contacts = spans(apart.at_ns, apart.distance == 0.0)
    before: int | None = None
    for first, last in contacts:
        if before is None or (apart.distance[before:first] > PARTED_M).any():
            at = int(apart.at_ns[first])
            figures = {"closing_speed_mps": float(apart.closing[first])}
            yield Event("collision", pair, at, figures, _between(run, pair, at))
        before = last


def _between(run: RunTables, pair: tuple[str, str], at: int) -> tuple[float, float]:
    one, other = (place_at(run.table(name, "truth"), at) for name in pair)
    return 0.5 * (one[0] + other[0]), 0.5 * (one[1] + other[1])


def _near_misses(
    run: RunTables, pair: tuple[str, str], apart: Gaps, near_m: float, near_s: float
) -> Iterator[Event]:
    """Yield spans below a gap (m) or a time to collision (s) without a collision."""
    nears = apart.closing > 0.0
    left = np.full(len(apart.at_ns), np.inf)
    left[nears] = apart.distance[nears] / apart.closing[nears]
    holds = (apart.distance < near_m) | (left < near_s) | (apart.distance == 0.0)
    for first, last in spans(apart.at_ns, holds, QUIET_NS):
        rows = np.arange(first, last + 1)[holds[first : last + 1]]
        if (apart.distance[rows] == 0.0).any():
            continue
        at = int(apart.at_ns[first])
        figures = {"gap_m_min": float(apart.distance[rows].min())}
        if left[rows].min() < np.inf:
            figures["time_to_collision_s_min"] = float(left[rows].min())
        yield Event("near_miss", pair, at, figures, _between(run, pair, at))


# ---- Lane, friction


def lane_departures(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield spans in which a corner is outside of the lane around the lead's driven path."""
    truth, offsets = run.table(follower, "truth"), corner_offsets(run, follower)
    excess = np.max(np.abs(offsets), axis=0) - 0.5 * run.scenario.tables.events.lane_width_m
    at = truth.at_ns
    for first, last in spans(at, excess > 0.0, QUIET_NS):
        figures = {
            "excess_m_max": float(np.nanmax(excess[first : last + 1])),
            "duration_s": seconds_between(at, first, last),
        }
        place = place_at(truth, at[first])
        yield Event("lane_departure", (follower,), int(at[first]), figures, place)


def slides(run: RunTables, name: str) -> Iterator[Event]:
    """Yield spans in which an axle uses all available friction, or more with linear tyres."""
    truth = run.table(name, "truth")
    at, friction = truth.at_ns, truth["friction_ratio"]
    holds = friction >= SLIDING_SHARE
    slip = np.maximum(np.abs(truth["front_slip_rad"]), np.abs(truth["rear_slip_rad"]))
    for first, last in spans(at, holds, QUIET_NS):
        figures = {
            "slip_rad_max": float(slip[first : last + 1][holds[first : last + 1]].max()),
            "friction_ratio_max": float(friction[first : last + 1].max()),
            "duration_s": seconds_between(at, first, last),
        }
        yield Event("slide", (name,), int(at[first]), figures, place_at(truth, at[first]))


# ---- Decisions of one vehicle


def stops(run: RunTables, name: str) -> Iterator[Event]:
    """Yield stops of a car that knows too little of the road ahead, each until it drives again.

    Those of a lead begin when it stands behind a member of its convoy that is silent.
    """
    tracking = run.table(name, "tracking")
    at, mode = tracking.at_ns, tracking["mode"]
    waits = is_one_of(mode, "path") & is_one_of(tracking["predecessor_status"], "lost")
    for first, last in spans(at, is_one_of(mode, "stop") | waits):
        known = {
            "known_m": float(tracking["known_m"][first]),
            "predicted_blind_m": float(tracking["blind_m"][first]),
        }
        figures = {key: value for key, value in known.items() if np.isfinite(value)}
        figures["duration_s"] = seconds_between(at, first, last)
        yield _of_decision(run, "stop", (name,), int(at[first]), figures)


def lost_paths(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield the spans longer than events.path_lost_s in which a follower lacks a trajectory.

    It had one before. A follower that continues along a known road has not lost its path.
    """
    tracking = run.table(follower, "tracking")
    at = tracking.at_ns
    holds = is_one_of(tracking["mode"], *LOST_MODES) & ~(tracking["known_m"] > 0.0)
    (known,) = np.nonzero(~holds)
    if not len(known):
        return
    holds[: known[0]] = False
    after = nanoseconds(run.scenario.tables.events.path_lost_s)
    for first, last in spans(at, holds):
        parts = np.flatnonzero(np.diff(at[first : last + 1]) > UNRECORDED_NS) + first
        for begin, end in zip([first, *(parts + 1)], [*parts, last], strict=True):
            if at[end] - at[begin] > after:
                figures = {"duration_s": seconds_between(at, begin, end)}
                yield _of_decision(run, "path_lost", (follower,), int(at[begin]), figures)


class SourceHistory(NamedTuple):
    """Status of a source and age (s) of its data at instants (ns) of decisions; shapes (N)."""

    at_ns: Integers
    status: Array
    age_s: Floats


@once
def sources(run: RunTables, follower: str) -> Mapping[str, SourceHistory]:
    """Sources of a follower: lead and predecessor at all its decisions, others where listed."""
    tracking, ahead = run.table(follower, "tracking"), run.ahead(follower)
    at, others, ages = tracking.at_ns, tracking["other_sources"], tracking.lists["other_age_s"]
    lengths, found = np.diff(ages.offsets), dict[str, list[tuple[Integers, Array, Floats]]]()
    for text in set(others.tolist()):
        for place, (name, status) in enumerate(statuses_in(text).items()):
            rows = np.flatnonzero(others == text)
            age_s, known = np.full(len(rows), np.nan), lengths[rows] > place
            age_s[known] = ages.values[ages.offsets[rows[known]] + place]
            found.setdefault(name, []).append((rows, np.full(len(rows), status, object), age_s))
    result = {}
    for name, parts in found.items():
        rows, states, age_s = map(np.concatenate, zip(*parts, strict=True))
        order = np.argsort(rows)
        result[name] = SourceHistory(at[rows[order]], states[order], age_s[order])
    if ahead != run.lead:
        result[ahead] = SourceHistory(
            at, tracking["predecessor_status"], tracking["predecessor_age_s"]
        )
    return result | {run.lead: SourceHistory(at, tracking["lead_status"], tracking["lead_age_s"])}


def distrusts(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield the spans in which a follower distrusts a source."""
    for source, (at, status, _) in sources(run, follower).items():
        for first, last in spans(at, is_one_of(status, "distrusted")):
            figures = {"duration_s": seconds_between(at, first, last)}
            yield _of_decision(run, "distrust", (source, follower), int(at[first]), figures)


def _of_decision(
    run: RunTables,
    kind: EventKind,
    vehicles: tuple[str, ...],
    at: int,
    figures: Mapping[str, float],
) -> Event:
    return Event(kind, vehicles, at, figures, place_at(run.table(vehicles[-1], "truth"), at))


def in_time_order(events: Iterable[Event]) -> Sequence[Event]:
    return sorted(events, key=lambda event: (event.at_ns, event.kind, event.vehicles))


def peak(values: Floats, first: int, last: int) -> float:
    return float(np.nanmax(values[first : last + 1]))
