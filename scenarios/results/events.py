"""Events of a run: spans of time in which a condition holds, as functions of the run's tables."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

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


# ---- Times in which a condition holds


def begins(holds: Flags) -> Flags:
    """Whether a condition begins to hold in each row."""
    first: Flags = holds & ~np.append(False, holds[:-1])
    return first


def lasting(
    run: RunTables,
    kind: EventKind,
    vehicles: tuple[str, ...],
    at: Integers,
    holds: Flags,
    *,
    peaks: Mapping[str, Floats] = MappingProxyType({}),
    firsts: Mapping[str, Floats] = MappingProxyType({}),
    least_ns: int = 0,
    quiet_ns: int = QUIET_NS,
    since: Integers | None = None,
) -> Iterator[Event]:
    """Yield an event for each time in which a condition `holds` at instants `at` (ns).

    Times shorter than `least_ns` are none, unless they follow another within `quiet_ns`: then both
    are one event. Its figures are the largest values of `peaks` and, where they are known, the
    first ones of `firsts`; it began at the instant in `since`.
    """
    found: list[tuple[int, int]] = []
    for first, last in spans(at, holds):
        if found and at[first] - at[found[-1][1]] <= quiet_ns:
            found[-1] = found[-1][0], last
        elif at[last] - at[first] >= least_ns:
            found.append((first, last))
    for first, last in found:
        begun = int(at[first] if since is None else since[first])
        known = {name: float(values[first]) for name, values in firsts.items()}
        figures = {name: value for name, value in known.items() if np.isfinite(value)}
        for name, values in peaks.items():
            figures[name] = float(np.nanmax(values[first : last + 1]))
        figures["duration_s"] = int(at[last] - begun) / SECOND
        place = place_at(run.table(vehicles[-1], "truth"), int(at[first]))
        yield Event(kind, vehicles, begun, figures, place)


def place_at(truth: Columns, at: int) -> tuple[float, float]:
    """Position (east, north, m) of a vehicle at its last true pose up to an instant (ns)."""
    row = int(np.searchsorted(truth.at_ns, at, side="right")) - 1
    return (float(truth["east_m"][row]), float(truth["north_m"][row])) if row >= 0 else (0.0, 0.0)


def in_time_order(events: Iterable[Event]) -> Sequence[Event]:
    return sorted(events, key=lambda event: (event.at_ns, event.kind, event.vehicles))


# ---- Encounters of two vehicles


def encounters(run: RunTables) -> Iterator[Event]:
    """Yield collisions of any two vehicles, and near misses of neighbours."""
    reach = max(float(np.hypot(size.length, size.width)) for size in body_sizes(run).values())
    for first, second in _may_meet(run, reach + REACH_MARGIN_M):
        if run.ahead(second) == first:
            yield from _collisions(run, (first, second), gaps(run, second))
            yield from _near_misses(run, (first, second), gaps(run, second))
        else:
            apart = distances(run, first, second, reach + REACH_MARGIN_M)
            yield from _collisions(run, (first, second), apart)


def _may_meet(run: RunTables, reach: float) -> Iterator[tuple[str, str]]:
    """Yield neighbours, and pairs of vehicles whose places come within a distance (m)."""
    extents = {}
    for name in run.names:
        truth = run.table(name, "truth")
        if len(truth):
            places = np.array([truth["east_m"], truth["north_m"]])
            extents[name] = places.min(axis=1), places.max(axis=1) + reach
    for pair in combinations(extents, 2):
        (low, high), (other_low, other_high) = map(extents.__getitem__, pair)
        if run.ahead(pair[1]) == pair[0] or ((low < other_high) & (other_low < high)).all():
            yield pair


def _collisions(run: RunTables, pair: tuple[str, str], apart: Gaps) -> Iterator[Event]:
    """Yield contacts; a new one needs bodies that have parted."""
    before: int | None = None
    for first, last in spans(apart.at_ns, apart.distance == 0.0):
        if before is None or (apart.distance[before:first] > PARTED_M).any():
            figures = {"closing_speed_mps": float(apart.closing[first])}
            yield _between(run, "collision", pair, int(apart.at_ns[first]), figures)
        before = last


def _near_misses(run: RunTables, pair: tuple[str, str], apart: Gaps) -> Iterator[Event]:
    """Yield spans below a gap (m) or a time to collision (s) without a collision."""
    rules, nears = run.scenario.tables.events, apart.closing > 0.0
    left = np.full(len(apart.at_ns), np.inf)
    with np.errstate(over="ignore"):  # at a closing speed of almost zero
        left[nears] = apart.distance[nears] / apart.closing[nears]
    holds = (apart.distance < rules.near_miss_gap_m) | (left < rules.near_miss_time_s)
    holds |= apart.distance == 0.0
    for first, last in spans(apart.at_ns, holds, QUIET_NS):
        rows = np.arange(first, last + 1)[holds[first : last + 1]]
        if (apart.distance[rows] == 0.0).any():
            continue
        figures = {"gap_m_min": float(apart.distance[rows].min())}
        if left[rows].min() < np.inf:
            figures["time_to_collision_s_min"] = float(left[rows].min())
        yield _between(run, "near_miss", pair, int(apart.at_ns[first]), figures)


def _between(
    run: RunTables, kind: EventKind, pair: tuple[str, str], at: int, figures: Mapping[str, float]
) -> Event:
    (east, north), (other_east, other_north) = (
        place_at(run.table(name, "truth"), at) for name in pair
    )
    place = 0.5 * (east + other_east), 0.5 * (north + other_north)
    return Event(kind, pair, at, figures, place)


# ---- Lane, friction


def lane_departures(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield spans in which a corner is outside of the lane around the lead's driven path."""
    at, offsets = run.table(follower, "truth").at_ns, corner_offsets(run, follower)
    excess = np.max(np.abs(offsets), axis=0) - 0.5 * run.scenario.tables.events.lane_width_m
    peaks = {"excess_m_max": excess}
    return lasting(run, "lane_departure", (follower,), at, excess > 0.0, peaks=peaks)


def slides(run: RunTables, name: str) -> Iterator[Event]:
    """Yield spans in which an axle uses all available friction, or more with linear tyres."""
    truth = run.table(name, "truth")
    friction = truth["friction_ratio"]
    holds = friction >= SLIDING_SHARE
    slip = np.maximum(np.abs(truth["front_slip_rad"]), np.abs(truth["rear_slip_rad"]))
    peaks = {"slip_rad_max": np.where(holds, slip, np.nan), "friction_ratio_max": friction}
    return lasting(run, "slide", (name,), truth.at_ns, holds, peaks=peaks)


# ---- Decisions of one vehicle


def stops(run: RunTables, name: str) -> Iterator[Event]:
    """Yield stops of a car that knows too little of the road ahead, each until it drives again.

    Those of a lead begin when it stands behind a member of its convoy that is silent.
    """
    tracking = run.table(name, "tracking")
    mode = tracking["mode"]
    waits = (mode == "path") & (tracking["predecessor_status"] == "lost")
    firsts = {"known_m": tracking["known_m"], "predicted_blind_m": tracking["blind_m"]}
    holds = (mode == "stop") | waits
    return lasting(run, "stop", (name,), tracking.at_ns, holds, firsts=firsts, quiet_ns=0)


def lost_paths(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield the spans longer than events.path_lost_s in which a follower lacks a trajectory.

    It had one before. A follower that continues along a known road has not lost its path.
    """
    tracking = run.table(follower, "tracking")
    least = nanoseconds(run.scenario.tables.events.path_lost_s) + 1
    at, mode = tracking.at_ns, tracking["mode"]
    lacks = np.isin(mode, LOST_MODES) & ~(tracking["known_m"] > 0.0)
    holds = lacks & np.maximum.accumulate(~lacks)
    recorded = np.split(np.arange(len(at)), np.flatnonzero(np.diff(at) > UNRECORDED_NS) + 1)
    for rows in recorded:
        yield from lasting(
            run, "path_lost", (follower,), at[rows], holds[rows], least_ns=least, quiet_ns=0
        )


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
        pair = (source, follower)
        yield from lasting(run, "distrust", pair, at, status == "distrusted", quiet_ns=0)
