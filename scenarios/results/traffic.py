"""Events that a traffic engineer notices although nothing collides.

A follower falls behind, stands although the lead drives, is faster than the lead, brakes hard
without a cause, or is driven by its guard instead of its longitudinal law.

All but the last are found in the true poses, ten times a second, at instants that all vehicles have
passed. Vehicles that have left or not yet joined the convoy, and replayed ones, are not judged.
"""

from collections import Counter, deque
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from math import hypot
from typing import NamedTuple

from scenarios.definition.changes import change_from_json
from scenarios.definition.errors import ScenarioError
from scenarios.definition.schema.change_tables import CrashTable, StallTable
from scenarios.results.encounters import BodySize, CarBody, Episode, EventKind, separation
from vehicles.driver.controller import SpacingPolicy
from vehicles.messages import Change, Command, Override, TruePose
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds

PERIOD_NS = 100 * MILLISECOND
"""Period of the judged instants."""
PATIENCE_NS = 10 * SECOND
"""How long an instant waits for the poses of all vehicles."""
FOREVER = 2**63
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


class _TrafficRow(NamedTuple):
    """State of a vehicle at an instant; the acceleration (m/s²) is the mean since `since_ns`."""

    since_ns: int
    at_ns: int
    speed: float
    acceleration: float
    body: CarBody


@dataclass(slots=True)
class _Vehicle:
    """Recent rows of a vehicle, and what is known of it."""

    rows: deque[_TrafficRow] = field(default_factory=deque)
    period: int = -1
    has_driven: bool = False
    was_close: bool = False
    first_gap: float | None = None
    away: list[tuple[int, bool]] = field(default_factory=list)
    faults: list[tuple[int, int]] = field(default_factory=list)

    def is_away(self, at: int) -> bool:
        return next((away for since, away in reversed(self.away) if since <= at), False)

    def has_fault(self, at: int) -> bool:
        return any(first <= at <= last for first, last in self.faults)


class TrafficWatch:
    """Events of the followers of a convoy in their true poses."""

    def __init__(
        self,
        sizes: Mapping[str, BodySize],
        policies: Mapping[str, SpacingPolicy] | None = None,
        away: Collection[str] = (),
        replayed: Collection[str] = (),
    ) -> None:
        """Take the bodies, lead first, and the desired gaps, bumper to bumper, of followers.

        A follower without a policy keeps its first gap. Vehicles that are `away` join later.
        """
        self._vehicles = {name: _Vehicle() for name in sizes}
        for name in away:
            self._vehicles[name].away.append((0, True))
        self._names, self._lead = list(sizes), next(iter(sizes))
        self._policies = policies or {}
        self._replayed = replayed
        self._frames: dict[int, dict[str, _TrafficRow]] = {}
        self._open: dict[tuple[EventKind, str], Episode] = {}
        self._reported: set[tuple[EventKind, str]] = set()

    def add_change(self, change: Change) -> None:
        """Take a change of a vehicle, which is not judged while it is away or at fault."""
        vehicle, at = self._vehicles[change.vehicle], change.effective_at_ns
        if change.kind in {"leave", "join"}:
            vehicle.away.append((at, change.kind == "leave"))
            for behind in self._names[self._names.index(change.vehicle) :]:
                self._vehicles[behind].was_close = False
        elif change.kind in {"stall", "crash"}:
            with suppress(ScenarioError):  # messages from the bus may be malformed
                table = change_from_json(change.table)
                if isinstance(table, StallTable | CrashTable):
                    until = FOREVER if table.for_s is None else at + nanoseconds(table.for_s)
                    vehicle.faults.append((at, until))

    def add(self, pose: TruePose, body: CarBody) -> Iterator[Episode]:
        """Take a pose and its body; yields the events that have begun by now."""
        vehicle, at = self._vehicles[pose.vehicle], pose.true_at_ns
        if at // PERIOD_NS == vehicle.period:
            return
        vehicle.period = at // PERIOD_NS
        last = vehicle.rows[-1] if vehicle.rows else None
        acceleration, since = 0.0, at
        if last is not None and 0 < at - last.at_ns <= LONGEST_STEP_NS:
            since = last.at_ns
            acceleration = (pose.speed_mps - last.speed) * SECOND / (at - since)
        row = _TrafficRow(since, at, pose.speed_mps, acceleration, body)
        vehicle.rows.append(row)
        if at - vehicle.rows[0].at_ns > LONGEST_MEMORY_NS:
            vehicle.rows.popleft()
        self._frames.setdefault(at, {})[pose.vehicle] = row
        yield from self._judged(at - PATIENCE_NS)

    def finish(self) -> Iterator[Episode]:
        """Judge the instants that still wait for poses."""
        yield from self._judged(max(self._frames, default=0))

    def _judged(self, until: int) -> Iterator[Episode]:
        while self._frames:
            at = min(self._frames)
            if at > until and len(self._frames[at]) < len(self._names):
                return
            frame = self._frames.pop(at)
            lead = frame.get(self._lead)
            present = [name for name in self._names if not self._vehicles[name].is_away(at)]
            for ahead, name in pairwise(present):
                if name in frame and name not in self._replayed:
                    yield from self._judge(name, frame[name], lead, frame.get(ahead))

    def _judge(
        self, name: str, row: _TrafficRow, lead: _TrafficRow | None, ahead: _TrafficRow | None
    ) -> Iterator[Episode]:
        vehicle, at = self._vehicles[name], row.at_ns
        if ahead is not None:
            excess = self._gap_excess(name, row, ahead)
            vehicle.was_close |= excess <= 0.0
            holds = vehicle.was_close and excess > 0.0
            yield from self._follow("falls_behind", name, row, excess if holds else 0.0, BEHIND_NS)
        at_fault = vehicle.has_fault(at)
        is_hard = row.acceleration < -(COMFORTABLE_MPS2 + BRAKING_MARGIN_MPS2)
        braking = is_hard and not at_fault and not self._is_caused(name, at)
        yield from self._follow("hard_braking", name, row, -row.acceleration if braking else 0.0)
        if lead is None:
            return
        vehicle.has_driven |= row.speed > DRIVING_MPS
        stands = row.speed < STANDING_MPS and lead.speed > DRIVING_MPS and not at_fault
        patience = STANDS_NS * self._names.index(name)
        yield from self._follow("stranded", name, row, stands and vehicle.has_driven, patience)
        faster = row.speed - SPEED_RATIO * lead.speed - SPEED_MARGIN_MPS
        if faster > 0.0:
            faster = row.speed - SPEED_RATIO * self._fastest_lead(row) - SPEED_MARGIN_MPS
        yield from self._follow("overspeed", name, row, faster)

    def _gap_excess(self, name: str, row: _TrafficRow, ahead: _TrafficRow) -> float:
        """Gap (m) beyond that which law and data age explain."""
        vehicle, policy = self._vehicles[name], self._policies.get(name)
        if policy is None and vehicle.first_gap is None:
            vehicle.first_gap = separation(ahead.body, row.body).distance
        desired = policy.desired(row.speed) if policy else vehicle.first_gap or 0.0
        allowed = desired + ALLOWED_GAP_M + ALLOWED_HEADWAY_S * row.speed
        one, other = row.body, ahead.body
        if hypot(other.east - one.east, other.north - one.north) < allowed:  # the usual case
            return -1.0
        return separation(other, one).distance - allowed

    def _is_caused(self, name: str, at: int) -> bool:
        """Whether a vehicle ahead braked beyond comfort."""
        return any(
            row.acceleration < -COMFORTABLE_MPS2
            for ahead in self._names[: self._names.index(name)]
            for row in self._vehicles[ahead].rows
            if at - CAUSE_NS <= row.at_ns <= at
        )

    def _fastest_lead(self, row: _TrafficRow) -> float:
        """Largest speed (m/s) of the lead since it was where the follower is, at least for 10 s."""
        rows = [one for one in self._vehicles[self._lead].rows if one.at_ns <= row.at_ns]
        east, north = row.body.east, row.body.north
        here = min(rows, key=lambda one: hypot(one.body.east - east, one.body.north - north))
        since = min(here.at_ns, row.at_ns - SPEED_MEMORY_NS)
        return max(one.speed for one in rows if one.at_ns >= since)

    def _follow(
        self, kind: EventKind, name: str, row: _TrafficRow, value: float, least_ns: int = 0
    ) -> Iterator[Episode]:
        """Follow a condition, which holds while `value` > 0; yields its event after `least_ns`."""
        key, at = (kind, name), row.at_ns
        episode = self._open.get(key)
        if not value > 0.0:
            if episode is not None and (key not in self._reported or episode.is_over(at)):
                del self._open[key]
                self._reported.discard(key)
            return
        if episode is None:
            begun = row.since_ns if kind == "hard_braking" else at
            place = (row.body.east, row.body.north)
            episode = self._open[key] = Episode(kind, (name,), begun, at, place=place)
        episode.until_ns = at
        if kind in FIGURE_OF:
            episode.most(FIGURE_OF[kind], value)
        episode.most("duration_s", (at - episode.at_ns) / SECOND)
        if key not in self._reported and at - episode.at_ns >= least_ns:
            self._reported.add(key)
            yield episode


FIGURE_OF: Mapping[EventKind, str] = {
    "falls_behind": "gap_excess_m_max",
    "hard_braking": "braking_mps2_max",
    "overspeed": "speed_excess_mps_max",
    "overridden": "overridden_ratio",
}
"""Figure of each event besides its duration."""


# ---- Overrides


@dataclass(slots=True)
class Overrides:
    """Commands of one vehicle after the first 2 s, and those that its guard overrode, by reason."""

    commands: int = 0
    by_reason: Counter[Override] = field(default_factory=Counter)
    first_at: int = 0
    place: tuple[float, float] = (0.0, 0.0)

    @property
    def ratio(self) -> float | None:
        return self.by_reason.total() / self.commands if self.commands else None

    @property
    def ratios(self) -> dict[str, float]:
        """Share of the time by reason, the largest first."""
        return {why: count / self.commands for why, count in self.by_reason.most_common()}


class OverrideWatch:
    """Shares of the time in which guards overrode the longitudinal laws of followers."""

    def __init__(self, followers: Collection[str], control_rate_hz: float) -> None:
        self.of = {name: Overrides() for name in followers}
        self._rate_hz = control_rate_hz
        self._is_finished = False

    def add(self, command: Command, start_at: int, place: tuple[float, float]) -> None:
        """Take a command of a follower at a place (m), in a run from `start_at` (ns)."""
        if command.decided_at_ns < start_at + SETTLING_NS:
            return
        overrides = self.of[command.vehicle]
        overrides.commands += 1
        if command.override:
            if not overrides.by_reason:
                overrides.first_at, overrides.place = command.decided_at_ns, place
            overrides.by_reason[command.override] += 1

    def finish(self) -> Iterator[Episode]:
        """Yield an event for each vehicle whose share is above OVERRIDDEN_RATIO, once."""
        if self._is_finished:
            return
        self._is_finished = True
        for name, overrides in self.of.items():
            ratio = overrides.ratio or 0.0
            if ratio > OVERRIDDEN_RATIO:
                lasted = overrides.by_reason.total() / self._rate_hz
                figures = {"overridden_ratio": ratio, "duration_s": lasted}
                at = overrides.first_at
                yield Episode("overridden", (name,), at, at, figures, place=overrides.place)
