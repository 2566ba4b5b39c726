"""Whether a source can be believed: a gate for the innovations of its poses.

As estimators refuse measurements (PX4's EKF2: 5 deviations of the position), but of a source that
tells its place, its speed and its heading, so that they can be held against each other. What is
consistently false from the first message to the last is not found: a source beside the road all
the time, or one that comes to a new place and stays.
"""

from collections import Counter, deque
from dataclasses import dataclass
from math import hypot, isfinite, sqrt
from typing import Literal

from vehicles.car.gnss import Fix, GnssNoise
from vehicles.driver.degradation.innovation import (
    CORNERING,
    LEAST_DEVIATION,
    MOST_DEVIATION,
    Innovation,
    Track,
    innovation,
    stated_variance,
)
from vehicles.schedule import SECOND

Distrust = Literal["", "frozen", "jumping", "impossible", "ghost", "over-confident"]
"""Why a source is not believed, or not wholly.

frozen          the same place again and again, at a speed
jumping         a place, or a heading, where it cannot have come to
impossible      what no car does: its acceleration, or a way that its speeds deny
ghost           two tracks under one name; this pose is not of the one that is believed
over-confident  believed, but its places scatter more than it says
"""

WINDOW = 16
"""So many poses tell whether a source is over-confident."""
TAIL = 5.99
"""One in twenty squared innovations of 2 degrees of freedom lies beyond."""
TELLING = 9
"""So many of the window beyond the tail: of independent ones by chance once in 10⁸ (binomial)."""
QUIETING = 4
"""With so few of them it is not over-confident any more (twice as many as by chance)."""
HONEST_MEDIAN = 0.73
"""Median of the smaller one of a pose's squared innovations against the two before it."""
MOST_INFLATION = 30.0
"""Beyond this it is not noise any more: one solver stated a twentieth of its true deviation."""
HEADINGS = 3
"""So many headings in a row beyond their gate: by chance as rare as 5 deviations of one."""
RESTART_POSES = 3
"""A new place is believed after so many poses at least, as by the trace that they are added to."""
FORGOTTEN = 3 * SECOND
"""Poses that were refused longer ago than this (ns) say nothing of a new one."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What to make of a pose (not in the paper): whether to use it, why not, how exact it is.

    `reason` is "over-confident" of poses that are believed, but not their accuracy; `deviation` (m,
    per axis) is what to assume instead.
    """

    believed: bool
    reason: Distrust
    deviation: float


class InnovationGate:
    """Judges the poses of one source in the order in which they are heard (beyond the paper).

    A pose is held against the newest one believed. Refused poses that agree with one another for
    `settle` are the source's new place, so none is shut out for ever. Counted are the `refused`.
    """

    def __init__(
        self,
        noise: GnssNoise | None = None,
        *,
        gate: float = 5.0,
        heading_gate: float = 3.0,
        settle: float = 1.0,
    ) -> None:
        """`noise` is that of the source's receiver, as assumed: of all but its position.

        Gates are in standard deviations, `settle` in s.
        """
        self._noise = noise or GnssNoise()
        self._gate = gate
        self._heading_gate = heading_gate
        self._settle = round(settle * SECOND)
        self._believed: Track | None = None
        self._level: Fix | None = None
        self._twisted = 0
        self._suspect: Track | None = None
        self._suspected: Distrust = ""
        self._agreed = 0
        self._agreed_since = 0
        self._interleaved = False
        self._heard: deque[Fix] = deque(maxlen=2)
        self._squares: deque[float] = deque(maxlen=WINDOW)
        self._inflation = 1.0
        self._place: Fix | None = None
        self._claimed = (0.0, 0.0)
        self.refused: Counter[Distrust] = Counter()

    def judge(self, now: int, fix: Fix) -> Verdict:
        """Judge a pose heard at `now` (ns) by its innovations (Kalman filter)."""
        if not isfinite(fix.east + fix.north + fix.yaw + fix.speed + fix.yaw_rate):
            return self._refuse(fix, "impossible")
        frozen = self._listen(fix)
        if self._believed is None:
            self._start(Track(fix))
            return self._believe(fix)
        one = innovation(self._believed.last, fix, self._noise)
        reason: Distrust = "frozen" if frozen else self._fault(self._believed, one, fix)
        if one.span <= 0.0:
            return self._refuse(fix, reason) if reason else self._believe(fix)
        reason = reason or self._twist(one, fix)
        if not reason:
            self._believed.push(one, fix)
            self._agreed, self._interleaved = 0, self._suspect is not None
            return self._believe(fix)
        return self._doubt(now, fix, reason)

    def _believe(self, fix: Fix) -> Verdict:
        reason: Distrust = "over-confident" if self._inflation > 1.0 else ""
        return Verdict(True, reason, self._deviation(fix))

    def _refuse(self, fix: Fix, reason: Distrust) -> Verdict:
        self.refused[reason] += 1
        return Verdict(False, reason, self._deviation(fix))

    def _deviation(self, fix: Fix) -> float:
        """What to assume of a pose's accuracy (m)."""
        if self._inflation == 1.0:
            return fix.accuracy
        return min(self._inflation * max(fix.accuracy, LEAST_DEVIATION), MOST_DEVIATION)

    def _start(self, track: Track) -> None:
        """Believe in a track from now on."""
        self._believed, self._suspect = track, None
        self._level, self._twisted = track.last, 0

    def _fault(self, track: Track, one: Innovation, fix: Fix) -> Distrust:
        """What is wrong with a pose, held against a track."""
        if one.gain > self._gate:
            return "impossible"
        if one.deviations(self._inflation) > self._gate:
            return "jumping"
        if one.span > 0.0 and (
            track.strays(one, fix, self._inflation) > self._gate
            or track.cornering(fix) > CORNERING + self._gate * fix.speed * self._noise.heading
        ):
            return "impossible"
        return "jumping" if one.turn > self._gate else ""

    def _twist(self, one: Innovation, fix: Fix) -> Distrust:
        """Whether the heading has been wrong several times in a row."""
        if self._believed is None or self._level is None:
            return ""
        turn = one.turn
        if self._level is not self._believed.last:
            turn = innovation(self._level, fix, self._noise).turn
        if turn <= self._heading_gate:
            self._level, self._twisted = fix, 0
            return ""
        self._twisted += 1
        return "jumping" if self._twisted >= HEADINGS else ""

    def _doubt(self, now: int, fix: Fix, reason: Distrust) -> Verdict:
        """Refuse a pose, unless it is the last one of those that make a new place."""
        track = self._suspect
        if track is not None and fix.measured_at - track.last.measured_at > FORGOTTEN:
            track = None
        if track is not None:
            one = innovation(track.last, fix, self._noise)
            if reason == "frozen" or self._fault(track, one, fix):
                track = None
            elif one.span > 0.0:
                track.push(one, fix)
        if track is None:
            self._suspect, self._suspected = Track(fix), reason
            self._agreed, self._agreed_since, self._interleaved = 1, now, False
            return self._refuse(fix, reason)
        if not self._agreed:
            self._agreed_since = now
        self._agreed += 1
        if self._agreed >= RESTART_POSES and now - self._agreed_since >= self._settle:
            self._start(track)
            return self._believe(fix)
        return self._refuse(fix, "ghost" if self._interleaved else self._suspected)

    def _listen(self, fix: Fix) -> bool:
        """Learn from a pose, believed or not, how exact and how frozen its source is."""
        if not self._heard:
            self._heard.append(fix)
            self._place = fix
            return False
        one = innovation(self._heard[-1], fix, self._noise)
        if one.span <= 0.0:
            return False
        frozen = self._stays(one, fix)
        if not frozen:
            square = one.square()
            if len(self._heard) > 1:
                square = min(square, innovation(self._heard[0], fix, self._noise).square())
            self._squares.append(square)
            self._inflate()
        self._heard.append(fix)
        return frozen

    def _stays(self, one: Innovation, fix: Fix) -> bool:
        """Whether the place stays where it was although the speed told must have moved it."""
        place = self._place or fix
        limit = self._gate * self._inflation * sqrt(stated_variance(place) + stated_variance(fix))
        if hypot(fix.east - place.east, fix.north - place.north) > limit:
            self._place, self._claimed = fix, (0.0, 0.0)
            return False
        if fix.speed > self._gate * self._noise.speed:
            east, north = self._claimed
            self._claimed = east + one.way[0], north + one.way[1]
        return hypot(*self._claimed) > 2.0 * limit

    def _inflate(self) -> None:
        """Take the source's accuracy for worse than stated while its innovations say so."""
        beyond = sum(square > TAIL for square in self._squares)
        if beyond >= (TELLING if self._inflation == 1.0 else QUIETING + 1):
            middle = sorted(self._squares)[len(self._squares) // 2]
            self._inflation = min(max(sqrt(middle / HONEST_MEDIAN), 1.01), MOST_INFLATION)
        else:
            self._inflation = 1.0
