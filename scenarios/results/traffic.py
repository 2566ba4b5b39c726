"""Events that a traffic engineer notices although nothing collides.

A follower falls behind, stands although the lead drives, is faster than the lead, brakes hard
without a cause, or is driven by its guard instead of its longitudinal law.

All but the last are found in the true poses, ten times a second. Vehicles that have left or not yet
joined the convoy, and replayed ones, are not judged.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from scenarios.definition.changes import change_from_json
from scenarios.definition.errors import ScenarioError
from scenarios.definition.schema.change_tables import CrashTable, StallTable
from scenarios.results.events import Event, EventKind, lasting, place_at
from scenarios.results.record import FOREVER
from scenarios.results.tables import RunTables, once
from scenarios.results.true_motion import at_instants, distances, first_of_periods, gaps
from transport.columns import Flags, Floats, Integers
from vehicles.messages import Override
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds

PERIOD_NS = 100 * MILLISECOND
"""Period of the judged instants."""
LONGEST_STEP_NS = 250 * MILLISECOND
"""Longest time between two poses from which an acceleration is computed."""

ALLOWED_GAP_M, ALLOWED_HEADWAY_S = 10.0, 1.5
"""Gap beyond the desired one that law and data age explain, at speed v: 10 m + 1.5 s × v. Without
its predecessor's data a follower keeps a headway of up to 1.5 s; 10 m cover the drive's lag and the
age of data at a change of speed."""
BEHIND_NS = SECOND
STANDING_MPS, DRIVING_MPS = 0.3, 2.0
STANDS_NS = 2 * SECOND
"""Time for which a vehicle may stand while the lead drives, for each vehicle from the second on: a
queue sets off one vehicle after the other."""
SPEED_RATIO, SPEED_MARGIN_MPS = 1.1, 0.5
SPEED_MEMORY_NS = 10 * SECOND
"""A follower is compared with the lead's fastest speed in this time, or since the lead was at the
follower's place, if that is longer ago."""
LONGEST_MEMORY_NS = 60 * SECOND
COMFORTABLE_MPS2, BRAKING_MARGIN_MPS2 = 1.5, 0.5
CAUSE_NS = 5 * SECOND
"""Braking of a vehicle ahead beyond comfort explains hard braking for this time."""
SETTLING_NS = 2 * SECOND
"""Begin of a run in which overrides do not count."""
OVERRIDDEN_RATIO = 0.2
"""Share of the time from which overrides are an event: the run shows the guard, not the law."""
FIGURE_OF: Mapping[EventKind, str] = {
    "falls_behind": "gap_excess_m_max",
    "hard_braking": "braking_mps2_max",
    "overspeed": "speed_excess_mps_max",
    "overridden": "overridden_ratio",
}
"""Figure of each event besides its duration."""


class TrafficMotion(NamedTuple):
    """A vehicle ten times a second: instants (ns), place (m), speed (m/s) and acceleration (m/s²).

    The acceleration is the mean since `since_ns`. Shapes (N).
    """

    at_ns: Integers
    since_ns: Integers
    east: Floats
    north: Floats
    speed: Floats
    acceleration: Floats


@once
def motion(run: RunTables, name: str) -> TrafficMotion:
    """TrafficMotion of a vehicle at its first true pose in each period."""
    truth = run.table(name, "truth")
    truth = truth.of(first_of_periods(truth.at_ns, PERIOD_NS))
    at, speed = truth.at_ns, truth["speed_mps"]
    step = np.diff(at, prepend=at[:1])
    is_known = (step > 0) & (step <= LONGEST_STEP_NS)
    acceleration = np.zeros(len(at))
    change = np.diff(speed, prepend=speed[:1])
    acceleration[is_known] = change[is_known] * SECOND / step[is_known]
    since = np.where(is_known, at - step, at)
    return TrafficMotion(at, since, truth["east_m"], truth["north_m"], speed, acceleration)


# ---- Vehicles that are not judged


def _changes(run: RunTables, name: str, *kinds: str) -> list[tuple[int, str, str]]:
    """Instant (ns), kind and table of each change of some kinds, in order of time."""
    changes = run.table(name, "change")
    rows = zip(changes.at_ns.tolist(), changes["kind"], changes["table"], strict=True)
    return sorted(row for row in rows if row[1] in kinds)


def is_away(run: RunTables, name: str, at: Integers) -> Flags:
    """Whether a vehicle has left, or not yet joined the convoy."""
    away = np.full(len(at), run.scenario.joins_late(name))
    for since, kind, _ in _changes(run, name, "leave", "join"):
        away[at >= since] = kind == "leave"
    return away


def has_fault(run: RunTables, name: str, at: Integers) -> Flags:
    """Whether a vehicle is stalled or has crashed, by a change of the run."""
    faults = np.zeros(len(at), bool)
    for since, _, text in _changes(run, name, "stall", "crash"):
        with suppress(ScenarioError):  # messages from the bus may be malformed
            table = change_from_json(text)
            if isinstance(table, StallTable | CrashTable):
                lasts = FOREVER if table.for_s is None else nanoseconds(table.for_s)
                faults |= (at >= since) & (at <= since + lasts)
    return faults


# ---- Events


def traffic_events(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield the events of a follower in true poses, at instants at which it is in the convoy."""
    if follower in run.scenario.replays:
        return
    own, lead, place = motion(run, follower), motion(run, run.lead), run.names.index(follower)
    ahead = np.full(len(own.at_ns), -1)
    for index, name in enumerate(run.names[:place]):
        ahead[~is_away(run, name, own.at_ns)] = index
    judged = (ahead >= 0) & ~is_away(run, follower, own.at_ns)
    at_fault = has_fault(run, follower, own.at_ns)
    is_hard = own.acceleration < -(COMFORTABLE_MPS2 + BRAKING_MARGIN_MPS2)
    braking = np.where(is_hard & ~at_fault & ~_is_caused(run, follower), -own.acceleration, 0.0)
    lead_speed = at_instants(own.at_ns, lead.at_ns, lead.speed)
    compared = judged & ~np.isnan(lead_speed)
    has_driven = np.maximum.accumulate(compared & (own.speed > DRIVING_MPS))
    stands = (own.speed < STANDING_MPS) & (lead_speed > DRIVING_MPS) & has_driven & ~at_fault
    faster = own.speed - SPEED_RATIO * lead_speed - SPEED_MARGIN_MPS
    for row in np.flatnonzero(compared & (faster > 0.0)):
        fastest = _fastest_lead(lead, own, int(row))
        faster[row] = own.speed[row] - SPEED_RATIO * fastest - SPEED_MARGIN_MPS
    behind, known = _falling_behind(run, follower, ahead, judged)
    rules: Sequence[tuple[EventKind, Floats, Flags, int]] = (
        ("falls_behind", behind, known, BEHIND_NS),
        ("hard_braking", braking, judged, 0),
        ("stranded", np.where(stands, 1.0, 0.0), compared, STANDS_NS * place),
        ("overspeed", faster, compared, 0),
    )
    for kind, values, rows, least_ns in rules:
        at, since = own.at_ns[rows], own.since_ns[rows] if kind == "hard_braking" else None
        yield from lasting(
            run,
            kind,
            (follower,),
            at,
            values[rows] > 0.0,
            peaks={FIGURE_OF[kind]: values[rows]} if kind in FIGURE_OF else {},
            least_ns=least_ns,
            since=since,
        )


def _falling_behind(
    run: RunTables, follower: str, ahead: Integers, judged: Flags
) -> tuple[Floats, Flags]:
    """Gap (m) beyond that which law and data age explain, once it was not, and where it is known.

    `ahead` are places in the convoy of the vehicle ahead.
    """
    own, excess = motion(run, follower), np.full(len(ahead), np.nan)
    for index in set(ahead[judged].tolist()):
        rows, name = judged & (ahead == index), run.names[index]
        is_next = name == run.ahead(follower)
        apart = gaps(run, follower) if is_next else distances(run, name, follower)
        gap = at_instants(own.at_ns, apart.at_ns, apart.distance)
        allowed = _desired_gap(run, own.speed, gap) + ALLOWED_GAP_M + ALLOWED_HEADWAY_S * own.speed
        excess[rows] = (gap - allowed)[rows]
    known = judged & ~np.isnan(excess)
    before = run.names[: run.names.index(follower) + 1]
    resets = sorted(at for name in before for at, *_ in _changes(run, name, "leave", "join"))
    was_close, close = np.zeros(len(ahead), bool), known & (excess <= 0.0)
    for rows in np.split(np.arange(len(ahead)), np.searchsorted(own.at_ns, resets)):
        was_close[rows] = np.maximum.accumulate(close[rows])
    return np.where(was_close & known, excess, 0.0), known


def _desired_gap(run: RunTables, speed: Floats, gap: Floats) -> Floats:
    """Desired gap (m), bumper to bumper; a follower without a policy keeps its first gap."""
    if run.scenario.tables.speed.followers == "gap":
        policy = run.scenario.tables.speed.gap
        return policy.standstill_m + policy.headway_s * speed
    known = gap[~np.isnan(gap)]
    return np.full(len(gap), known[0] if len(known) else 0.0)


def _is_caused(run: RunTables, follower: str) -> Flags:
    """Whether a vehicle ahead braked beyond comfort up to CAUSE_NS before."""
    at = motion(run, follower).at_ns
    caused = np.zeros(len(at), bool)
    for name in run.names[: run.names.index(follower)]:
        other = motion(run, name)
        braked = other.at_ns[other.acceleration < -COMFORTABLE_MPS2]
        latest = np.searchsorted(braked, at, side="right")
        caused |= (latest > 0) & (at - np.append(braked, 0)[latest - 1] <= CAUSE_NS)
    return caused


def _fastest_lead(lead: TrafficMotion, own: TrafficMotion, row: int) -> float:
    """Largest speed (m/s) of the lead since it was where the follower is, at least for 10 s."""
    at = own.at_ns[row]
    known = (lead.at_ns <= at) & (lead.at_ns >= at - LONGEST_MEMORY_NS)
    away = np.hypot(lead.east[known] - own.east[row], lead.north[known] - own.north[row])
    instants = lead.at_ns[known]
    since = min(instants[np.argmin(away)], at - SPEED_MEMORY_NS)
    return float(lead.speed[known][instants >= since].max())


# ---- Overrides


class Overrides(NamedTuple):
    """Share of the time, from 2 s after the start, in which the guard acted, None if unknown.

    `ratios` are the shares by reason, the largest first; `lasted_s` is the time in all.
    """

    ratio: float | None
    ratios: Mapping[str, float]
    first_at: int
    lasted_s: float


@once
def overrides(run: RunTables, follower: str) -> Overrides:
    """Shares of the time in which the guard overrode the longitudinal law of a follower."""
    command = run.table(follower, "command")
    command = command.of(command.at_ns >= run.beginning + SETTLING_NS)
    at, reasons = command.at_ns, command["override"]
    if not len(reasons):
        return Overrides(None, {}, 0, 0.0)
    (rows,) = np.nonzero(reasons != "")
    counts = Counter[Override](reasons[rows].tolist())
    shares = {reason: count / len(reasons) for reason, count in counts.most_common()}
    first_at = int(at[rows[0]]) if len(rows) else 0
    lasted_s = len(rows) / run.scenario.control_rate_hz
    return Overrides(len(rows) / len(reasons), shares, first_at, lasted_s)


def overridden(run: RunTables, follower: str) -> Iterator[Event]:
    """Yield an event for a follower whose law was overridden for more than OVERRIDDEN_RATIO."""
    found = overrides(run, follower)
    if found.ratio is not None and found.ratio > OVERRIDDEN_RATIO:
        figures = {"overridden_ratio": found.ratio, "duration_s": found.lasted_s}
        place = place_at(run.table(follower, "truth"), found.first_at)
        yield Event("overridden", (follower,), found.first_at, figures, place)
