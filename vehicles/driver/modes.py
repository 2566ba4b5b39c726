"""Modes of a follower: the sources that it steers along, slowing down, stopping."""

from collections.abc import Iterable, Sequence
from math import isnan, sqrt
from typing import Final, Protocol

from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import (
    CREEP_SPEED,
    LOST,
    SLOWING,
    STANDSTILL,
    STOP_MARGIN,
    Situation,
    needed_deceleration,
)
from vehicles.driver.source import Source
from vehicles.driver.sources import Sources
from vehicles.messages import Mode
from vehicles.schedule import SECOND

FALLEN_BACK: Final = 5.0  # Known path (m) with which it follows again after falling back
MILD: Final = 0.5  # Share of comfortable braking from which a car slows for a hole
BEFORE_HOLE: Final = 20.0
"""A car that has stopped drives on towards a hole that it cannot cross only from this distance (m)
on."""
STILL_RECEIVED: Final = 5.0  # Longest silence (s) of a source of a slow car
NOTHING_RECEIVED: Final = "nothing received yet"
NO_TRAJECTORY: Final = "no trajectory through the received samples"


class Modes(Protocol):
    def decide(
        self,
        now: int,
        sources: Sources,
        situation: Situation,
        speed: float,
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        """Mode at a control instant `now` (ns) at `speed` (m/s), and the reason for the log.

        `fitted` states whether the last fit found a trajectory, `has_path` whether any fit did.
        """
        ...


class ModeMachine:
    """Composite → one source alone → coast → stop, and back.

    The car steers along the sources that it relies on. Without any, or if all of them may have left
    the path, it coasts while a stop within the known path needs no more than comfortable braking,
    and otherwise stops until a source is relied on again. It also stops if no first message arrives
    in time. Where messages arrive rarely it drives on slowly, from a standstill along the known
    path. If sources are received, but their known path ends behind the car, it coasts until
    enough lies ahead. If it ends at a hole, the car creeps across it, or stops before it until the
    hole is filled.

    A lost source is dropped at once and relied on again only after its probation (`Source`). A
    worse mode is kept for the same time, so that no mode is entered twice within it.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._comfortable = settings.comfortable.deceleration
        self._hardest = settings.emergency.deceleration
        self._dwell = settings.probation
        self._worse_at = 0
        self._outrun_since: int | None = None
        self._mode: Mode = "straight"
        self._relied: list[Source] = []
        self._lost: set[str] = set()
        self._is_slow = False

    def decide(
        self,
        now: int,
        sources: Sources,
        situation: Situation,
        speed: float,
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        relied = list(sources.relied.values())
        soon = (now - self._worse_at) / SECOND < self._dwell
        outrun = self._is_outrun(now, sources, situation)
        mode = None
        if relied and has_path and situation.hole > 0.0:
            mode = self._at_hole(situation, speed)
        elif relied and has_path and sources.path_runs_out:
            mode = self._overdue(relied, situation, speed)
        if mode is None:
            mode = self._next(
                sources, situation, speed, has_path=has_path, outrun=outrun, soon=soon
            )
        slow = self._slow_mode(sources, situation, speed) if has_path and mode in SLOWING else None
        self._is_slow = slow is not None
        mode = slow or mode
        why = "; ".join([_missing_reason(s) for s in sources.used.values() if s not in relied])
        if mode == "straight":
            why = why if has_path else NOTHING_RECEIVED
        elif mode == "creep":
            situation.blind = max(situation.blind, situation.hole)
            why = "; ".join(filter(None, [why, f"crosses a hole of {situation.hole:.1f} m"]))
        elif slow is not None:
            path = f"drives slowly along {situation.known:.1f} m of known path"
            why = "; ".join(filter(None, [why, path]))
        elif mode in SLOWING:
            why = "; ".join(filter(None, [why, _stopping_reason(situation, speed)]))
        if mode != self._mode:
            if mode in SLOWING or self._mode == "composite":
                self._worse_at = now
            why = "; ".join(filter(None, [*self._recoveries(mode, relied), why]))
            why = why or "; ".join([self._recovery_reason(source) for source in relied])
        self._mode, self._relied = mode, relied
        self._note_lost(sources)
        return mode, why

    def _recoveries(self, mode: Mode, relied: Sequence[Source]) -> list[str]:
        """Reasons of a change to `mode`: the sources that give a path again."""
        resumes = self._mode in SLOWING and mode not in SLOWING
        return [
            self._recovery_reason(source)
            for source in relied
            if source.gives_path and (resumes or source not in self._relied)
        ]

    def _note_lost(self, sources: Sources) -> None:
        for source in sources.used.values():
            if source.status in LOST or source.status == "probation":
                self._lost.add(source.name)
            elif self._mode not in SLOWING and source in self._relied:
                self._lost.discard(source.name)

    def _is_outrun(self, now: int, sources: Sources, situation: Situation) -> bool:
        """Whether the known path has ended behind the car for longer than the probation.

        This happens if messages take longer to arrive than the car needs to close the gap: the car
        must fall back to have a path ahead.
        """
        enough = FALLEN_BACK if self._mode in SLOWING else 0.0
        outrun = situation.known <= enough and any(
            source.gives_path for source in sources.used.values()
        )
        if not outrun:
            self._outrun_since = None
            return False
        if self._outrun_since is None:
            self._outrun_since = now
        return (now - self._outrun_since) / SECOND > self._dwell

    def _next(
        self,
        sources: Sources,
        situation: Situation,
        speed: float,
        *,
        has_path: bool,
        outrun: bool,
        soon: bool,
    ) -> Mode:
        """The next mode; not a better one `soon` after a worse one."""
        relied, slows = list(sources.relied.values()), self._mode in SLOWING
        if relied and has_path and not outrun and not (soon and slows):
            alone = [sources.mode_along(source) for source in relied]
            if len(alone) == 1 or (soon and self._mode in alone):
                return self._mode if self._mode in alone else alone[0]
            return "composite"
        if not slows and not outrun and (relied or not _any_lost(sources.used.values())):
            return "straight"  # nothing received yet, or no trajectory fitted
        known = 0.0 if isnan(situation.known) else situation.known
        if outrun:  # the vehicles ahead are received: fall back, no need to stop
            return "coast"
        if self._mode == "stop" or needed_deceleration(speed, known) > self._comfortable:
            return "stop"
        return "coast"

    def _at_hole(self, situation: Situation, speed: float) -> Mode | None:
        """Mode before or in a hole of the known path, None while the hole is far away."""
        left = situation.known - STOP_MARGIN
        near = 0.0
        if self._mode in SLOWING:
            near = FALLEN_BACK if situation.crossable else BEFORE_HOLE
        final = CREEP_SPEED if situation.crossable else 0.0
        needed = 0.0
        if speed > final:
            needed = needed_deceleration(speed, left) * (1.0 - (final / speed) ** 2)
        if left > near and needed <= MILD * self._comfortable:
            return None
        if situation.crossable:
            return "creep"
        return "stop" if self._mode == "stop" or needed > self._comfortable else "coast"

    def _overdue(self, relied: list[Source], situation: Situation, speed: float) -> Mode | None:
        """Mode while messages of sources that send rarely are overdue, None to drive on.

        Such a source is lost only after several of its periods. The car stops while the known path
        still suffices.
        """
        if min([source.freshness.silence for source in relied]) <= self._dwell:
            return None
        needed = needed_deceleration(speed, situation.known - STOP_MARGIN)
        if self._mode == "coast" and needed <= self._comfortable:
            return "coast"
        if self._mode in SLOWING or self._comfortable < needed <= self._hardest:
            return "stop"
        return None

    def _slow_mode(self, sources: Sources, situation: Situation, speed: float) -> Mode | None:
        """Mode of a car that has stopped and drives slowly along the known path, None if it waits.

        It does while messages arrive, but too few for any source to pass its probation.
        """
        least = STOP_MARGIN if self._is_slow else FALLEN_BACK
        highest = CREEP_SPEED + STANDSTILL if self._is_slow else STANDSTILL
        received = {
            source.freshness.known: sources.mode_along(source)
            for source in sources.used.values()
            if source.freshness.silence < STILL_RECEIVED
            and source.status != "distrusted"
            and source.probation.length > self._dwell
        }
        if sources.relied or not received or not (speed < highest and situation.known > least):
            return None
        left = 2.0 * self._comfortable * (situation.known - STOP_MARGIN)
        situation.speed_limit = min(CREEP_SPEED, sqrt(left))
        return received[max(received)]

    def _recovery_reason(self, source: Source) -> str:
        freshness, event = source.freshness, "received"
        if source.name in self._lost:
            event = f"trusted again after {source.probation_length:.1f} s of probation"
        pose = f"newest pose {freshness.age:.2f} s old"
        return f"{source.name} {event}, {pose}, {_path_end(freshness.known)}"


class ModesByReach:
    """Modes of the baselines, which continue at full speed.

    The car steers along sources whose samples reach ahead of it, however old they are. Without any
    it coasts: along its last trajectory, or by its configured reaction.
    """

    def decide(
        self,
        now: int,
        sources: Sources,
        situation: Situation,
        speed: float,
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        reaching = [sources.mode_along(one) for one in sources.used.values() if one.reaches]
        silent = [source for source in sources.used.values() if not source.reaches]
        why = ", ".join(
            f"{s.name} not received yet"
            if isnan(s.freshness.age)
            else f"newest pose of {s.name} {s.freshness.age:.1f} s old"
            for s in silent
        )
        if not has_path:
            return "straight", NOTHING_RECEIVED
        if not fitted:
            return "coast", why or NO_TRAJECTORY
        return ("composite" if len(reaching) > 1 else reaching[0]), why


def _any_lost(sources: Iterable[Source]) -> bool:
    """Whether a source was lost or left the path, or no first message arrived in time."""
    sources = list(sources)
    lost = any(
        source.status in LOST or source.status == "probation" or source.has_left_path
        for source in sources
    )
    return lost or all(source.never_received for source in sources)


def _missing_reason(source: Source) -> str:
    freshness, name = source.freshness, source.name
    if freshness.status == "unheard":
        return f"{name} not received yet"
    if freshness.status == "distrusted":
        return f"{name} distrusted as {source.refusal} for {freshness.silence:.1f} s"
    if freshness.status == "probation":
        return f"{name} on probation for {source.probation_length:.1f} s"
    if freshness.status == "lost":
        pose = f"newest pose {freshness.age:.1f} s old"
        silence = f"silent for {freshness.silence:.1f} s"
        return f"{name} {silence}, {pose}, {_path_end(freshness.known)}"
    if source.has_left_path:
        return f"{name} may be off the path in mode {freshness.mode}"
    return f"{name} has too few poses"


def _path_end(known: float) -> str:
    return f"path ends {abs(known):.1f} m {'ahead' if known >= 0.0 else 'behind'}"


def _stopping_reason(situation: Situation, speed: float) -> str:
    if isnan(situation.known):
        return "no known path"
    if situation.hole > 0.0 and speed < STANDSTILL:
        return f"waits before a hole of {situation.hole:.1f} m"
    known = f"{max(situation.known, 0.0):.1f} m of known path"
    if situation.hole > 0.0:
        known = f"{known} before a hole of {situation.hole:.1f} m"
    if situation.blind > 0.0:
        return f"{known}, {situation.blind:.1f} m too short to stop"
    return f"{known}: a stop needs {needed_deceleration(speed, situation.known):.1f} m/s²"
