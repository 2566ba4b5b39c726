"""Which of its sources a follower steers along, and when it slows down and stops: its mode."""

from collections.abc import Iterable
from math import isnan
from typing import Final, Protocol

from vehicles.driver.degradation.pair import SourcePair
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.slowing.stopping import needed_deceleration
from vehicles.driver.degradation.sources import RELIED_ON, Source
from vehicles.messages import Mode
from vehicles.schedule import SECOND

SLOWING: tuple[Mode, ...] = ("coast", "stop")
"""In these modes nobody tells the road ahead, and a follower that degrades slows down."""
FALLEN_BACK: Final = 5.0
"""Who fell back because all it heard was of road behind it follows again with so much (m) ahead."""
NOTHING_HEARD: Final = "nothing heard yet"


class Modes(Protocol):
    """Decides on the mode of a follower."""

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
        """Mode at a control instant `now` (ns) at `speed` (m/s), and why.

        `fitted` says whether the samples supported a trajectory when last fitted, `has_path`
        whether they ever did.
        """
        ...


class ModeMachine:
    """Composite → lead or predecessor → coast → stop, and back.

    Steered along is who is relied on. Who hears nobody coasts as long as a stop within the known
    path needs no more than comfortable braking, and stops otherwise, until somebody is relied on
    again; who has waited in vain for a first message stops, too. Who hears somebody, but only of
    road behind the car, coasts until enough lies ahead. A source is given up at once and relied on
    again only after its probation (`Source`), and a mode that was the worse one is left for a
    better one only after as long, so that none is entered twice within one.
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
        fitted: bool,  # noqa: ARG002 - what was fitted last is steered along
        has_path: bool,
    ) -> tuple[Mode, str]:
        """Mode at a control instant `now` (ns) at `speed` (m/s), and why.

        Why is what is missing, and when the mode changes who is relied on anew.
        """
        by_mode = {mode: one for mode, one in pair.used.items() if one.relied_on}
        relied = list(by_mode.values())
        soon = (now - self._worse_at) / SECOND < self._dwell
        has_way = not self._is_outrun(now, pair, situation)
        mode = self._next(
            pair, list(by_mode), situation, speed, has_path=has_path, has_way=has_way, soon=soon
        )
        why = ""
        if len(relied) < len(pair.used):
            why = _missing(one for one in pair.used.values() if one not in relied)
        if mode == "straight":
            why = why if has_path else NOTHING_HEARD
        elif mode in SLOWING:
            why = "; ".join(filter(None, [why, _road_left(situation, speed)]))
        if mode != self._mode:
            if mode in SLOWING or self._mode == "composite":
                self._worse_at = now
            goes_on = self._mode in SLOWING and mode not in SLOWING
            back = [self._anew(one) for one in relied if goes_on or one not in self._relied]
            why = "; ".join(filter(None, [*back, why]))
        if relied != self._relied:
            self._trusted |= {one.name for one in relied}
        self._mode, self._relied = mode, relied
        return mode, why

    def _is_outrun(self, now: int, pair: SourcePair, situation: Situation) -> bool:
        """Whether all that is heard has for long been told of road that lies behind the car.

        So it is where a gap takes less time to drive than a message takes to come: the car never
        knows where to drive, unless it falls back.
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
        relied: list[Mode],
        situation: Situation,
        speed: float,
        *,
        has_path: bool,
        has_way: bool,
        soon: bool,
    ) -> Mode:
        """The mode that follows; to a better one not too `soon` after one to a worse."""
        if relied and has_path and has_way and not (soon and self._mode in SLOWING):
            if len(relied) == 1 or (soon and self._mode in relied):
                return self._mode if self._mode in relied else relied[0]
            return "composite"
        used = pair.used.values()
        given_up = any(one.status in ("lost", "distrusted", "probation") for one in used)
        given_up = given_up or all(one.never_came for one in used)
        if self._mode not in SLOWING and has_way and (relied or not given_up):
            return "straight"  # nobody was heard yet, or nothing came of it
        known = 0.0 if isnan(situation.known) else situation.known
        if not has_way:  # those ahead are heard, so that there is no need to stop: it falls back
            return "coast"
        if self._mode == "stop" or needed_deceleration(speed, known) > self._comfortable:
            return "stop"
        return "coast"

    def _anew(self, source: Source) -> str:
        seen = source.freshness
        how = "heard"
        if source.name in self._trusted and source not in self._relied:
            how = f"relied on again after {source.probation.length:.1f} s of probation"
        return f"{source.name} {how}, {seen.age:.2f} s old, {_end(seen.known)}"


def _missing(sources: Iterable[Source]) -> str:
    """What is the matter with those that are not relied on."""
    return ", ".join(map(_matter, sources))


def _matter(source: Source) -> str:
    seen = source.freshness
    if seen.status == "unheard":
        return f"{source.name} never heard"
    if seen.status == "distrusted":
        return f"{source.name} not believed ({source.refusal}) for {seen.silence:.1f} s"
    if seen.status == "probation":
        return f"{source.name} heard again, on probation for {source.probation.length:.1f} s"
    if seen.status == "lost":
        age = f"unheard for {seen.silence:.1f} s, {seen.age:.1f} s old"
        return f"{source.name} {age}, {_end(seen.known)}"
    return f"{source.name} heard too little of"


def _end(known: float) -> str:
    place = f"{known:.1f} m ahead" if known >= 0.0 else f"{-known:.1f} m behind"
    return f"its path ends {place}"


def _road_left(situation: Situation, speed: float) -> str:
    """How a stop fits into the known path, in words."""
    if isnan(situation.known):
        return "no path known"
    needed = needed_deceleration(speed, situation.known)
    if situation.blind > 0.0:
        return f"{max(situation.known, 0.0):.1f} m known, {situation.blind:.1f} m too short to stop"
    return f"{situation.known:.1f} m known, a stop within takes {needed:.1f} m/s²"
