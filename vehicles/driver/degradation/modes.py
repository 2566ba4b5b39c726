"""Modes of a follower: the sources that it steers along, slowing down, stopping."""

from collections.abc import Iterable
from dataclasses import replace
from math import isnan
from typing import Final, Protocol

from vehicles.driver.degradation.settings import DegradationSettings, Reaction
from vehicles.driver.degradation.situation import LOST, SLOWING, Situation
from vehicles.driver.degradation.source import RELIED_ON, Source
from vehicles.driver.degradation.sources import SourcePair
from vehicles.driver.degradation.stopping import needed_deceleration
from vehicles.driver.steering import SteeringCommand
from vehicles.messages import Mode
from vehicles.schedule import SECOND

FALLEN_BACK: Final = 5.0
"""A follower that fell back, because all poses lay behind it, follows again with this (m) ahead."""
NOTHING_RECEIVED: Final = "nothing heard yet"
NO_TRAJECTORY: Final = "no trajectory through what is heard"


class Modes(Protocol):
    def decide(
        self,
        now: int,
        pair: SourcePair,
        situation: Situation,
        speed: float,
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        """Mode at a control instant `now` (ns) at `speed` (m/s), and the reason for the log.

        `fitted` states whether the samples supported a trajectory at the last fit, `has_path`
        whether they ever did.
        """
        ...


class ModeMachine:
    """Composite → lead or predecessor → coast → stop, and back.

    The car steers along the sources that it relies on. Without any it coasts as long as a stop
    within the known path needs no more than comfortable braking, and stops otherwise, until a
    source is relied on again; it also stops if no first message comes in time. If sources are
    received, but all their road lies behind the car, it coasts until enough lies ahead. A source
    is given up at once and relied on again only after its probation (`Source`), and a worse mode is
    left for a better one only after the same time, so that no mode is entered twice within it.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._comfortable = settings.comfortable.deceleration
        self._dwell = settings.probation
        self._worse_at = 0
        self._outrun_since: int | None = None
        self._mode: Mode = "straight"
        self._relied: list[Source] = []
        self._trusted: set[str] = set()

    def decide(
        self,
        now: int,
        pair: SourcePair,
        situation: Situation,
        speed: float,
        *,
        fitted: bool,  # noqa: ARG002 - it steers along the last trajectory
        has_path: bool,
    ) -> tuple[Mode, str]:
        """The reason names missing sources and, at a change, those relied on again."""
        relied = list(pair.relied.values())
        soon = (now - self._worse_at) / SECOND < self._dwell
        outrun = self._is_outrun(now, pair, situation)
        mode = self._next(pair, situation, speed, has_path=has_path, outrun=outrun, soon=soon)
        why = ""
        if len(relied) < len(pair.used):
            why = ", ".join(
                [_missing_reason(one) for one in pair.used.values() if one not in relied]
            )
        if mode == "straight":
            why = why if has_path else NOTHING_RECEIVED
        elif mode in SLOWING:
            why = "; ".join(filter(None, [why, _stopping_reason(situation, speed)]))
        if mode != self._mode:
            if mode in SLOWING or self._mode == "composite":
                self._worse_at = now
            goes_on = self._mode in SLOWING and mode not in SLOWING
            back = [
                self._recovery_reason(one) for one in relied if goes_on or one not in self._relied
            ]
            why = "; ".join(filter(None, [*back, why]))
        if relied != self._relied:
            self._trusted |= {one.name for one in relied}
        self._mode, self._relied = mode, relied
        return mode, why

    def _is_outrun(self, now: int, pair: SourcePair, situation: Situation) -> bool:
        """Whether all received road has been behind the car for longer than the probation.

        That is so where the gap takes less time to drive than a message takes to arrive: the car
        must fall back to have a path ahead.
        """
        enough = FALLEN_BACK if self._mode in SLOWING else 0.0
        outrun = situation.known <= enough and any(
            one.status in RELIED_ON for one in pair.used.values()
        )
        if not outrun:
            self._outrun_since = None
            return False
        if self._outrun_since is None:
            self._outrun_since = now
        return (now - self._outrun_since) / SECOND > self._dwell

    def _next(
        self,
        pair: SourcePair,
        situation: Situation,
        speed: float,
        *,
        has_path: bool,
        outrun: bool,
        soon: bool,
    ) -> Mode:
        """The next mode; no better one too `soon` after a worse one."""
        relied, slows = list(pair.relied), self._mode in SLOWING
        if relied and has_path and not outrun and not (soon and slows):
            if len(relied) == 1 or (soon and self._mode in relied):
                return self._mode if self._mode in relied else relied[0]
            return "composite"
        if not slows and not outrun and (relied or not _any_lost(pair.used.values())):
            return "straight"  # no source was received yet, or no trajectory came of it
        known = 0.0 if isnan(situation.known) else situation.known
        if outrun:  # the vehicles ahead are received: fall back, no need to stop
            return "coast"
        if self._mode == "stop" or needed_deceleration(speed, known) > self._comfortable:
            return "stop"
        return "coast"

    def _recovery_reason(self, source: Source) -> str:
        seen = source.freshness
        how = "heard"
        if source.name in self._trusted and source not in self._relied:
            how = f"relied on again after {source.probation.length:.1f} s of probation"
        return f"{source.name} {how}, {seen.age:.2f} s old, {_path_end(seen.known)}"


class ModesByReach:
    """Modes of the baselines, which continue at full speed.

    The car steers along the sources whose samples reach ahead of it, however old they are. Without
    any it coasts: along its last trajectory, or by its configured reaction.
    """

    def decide(
        self,
        now: int,  # noqa: ARG002
        pair: SourcePair,
        situation: Situation,  # noqa: ARG002
        speed: float,  # noqa: ARG002
        *,
        fitted: bool,
        has_path: bool,
    ) -> tuple[Mode, str]:
        reaching = [mode for mode, one in pair.used.items() if one.reaches]
        silent = [one for one in pair.used.values() if not one.reaches]
        why = ", ".join(
            f"{one.name} never heard" if isnan(age) else f"{one.name} unheard for {age:.1f} s"
            for one in silent
            for age in [one.freshness.age]
        )
        if not has_path:
            return "straight", NOTHING_RECEIVED
        if not fitted:
            return "coast", why or NO_TRAJECTORY
        return ("composite" if len(reaching) > 1 else reaching[0]), why


def steering_without_sources(
    reaction: Reaction, mode: Mode, wanted: SteeringCommand, last: SteeringCommand
) -> SteeringCommand:
    """Steering command while no source is followed: "hold" keeps the `last` one.

    "straight" turns the wheels straight, as the guardian of the Apollo system does; all others
    steer as `wanted` along their trajectory.
    """
    if mode != "coast" or reaction in ("degrade", "extrapolate"):
        return wanted
    if reaction == "hold":
        return last
    return replace(wanted, steering=0.0, feedforward=0.0, feedback=0.0)


def _any_lost(sources: Iterable[Source]) -> bool:
    """Whether a source was lost, or no first message of any came in time."""
    sources = list(sources)
    lost = any(one.status in LOST or one.status == "probation" for one in sources)
    return lost or all(one.never_received for one in sources)


def _missing_reason(source: Source) -> str:
    seen = source.freshness
    if seen.status == "unheard":
        return f"{source.name} never heard"
    if seen.status == "distrusted":
        return f"{source.name} not believed ({source.refusal}) for {seen.silence:.1f} s"
    if seen.status == "probation":
        return f"{source.name} heard again, on probation for {source.probation.length:.1f} s"
    if seen.status == "lost":
        age = f"unheard for {seen.silence:.1f} s, {seen.age:.1f} s old"
        return f"{source.name} {age}, {_path_end(seen.known)}"
    return f"{source.name} heard too little of"


def _path_end(known: float) -> str:
    place = f"{known:.1f} m ahead" if known >= 0.0 else f"{-known:.1f} m behind"
    return f"its path ends {place}"


def _stopping_reason(situation: Situation, speed: float) -> str:
    if isnan(situation.known):
        return "no path known"
    needed = needed_deceleration(speed, situation.known)
    if situation.blind > 0.0:
        return f"{max(situation.known, 0.0):.1f} m known, {situation.blind:.1f} m too short to stop"
    return f"{situation.known:.1f} m known, a stop within takes {needed:.1f} m/s²"
