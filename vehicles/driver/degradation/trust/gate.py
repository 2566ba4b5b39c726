"""Whether a source can be believed: a gate for the innovations of its poses.

As estimators refuse measurements (PX4's EKF2: 5 deviations of the position), but of a source that
tells its place, its speed and its heading, so that they can be held against each other. What is
consistently false from the first message to the last is not found: a source beside the road all
the time, or one that comes to a new place and stays.
"""

from collections import Counter, deque
from itertools import pairwise
from math import hypot, isfinite, sqrt
from typing import Final, Literal, NamedTuple

from vehicles.car.gnss import Fix
from vehicles.car.positioning.noise import GnssNoise
from vehicles.driver.degradation.trust.innovation import (
    CORNERING,
    LEAST_DEVIATION,
    MOST_DEVIATION,
    Innovation,
    PoseTrack,
    gained,
    innovation,
    stated_variance,
    turned,
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

WINDOW: Final = 32
"""So many poses tell whether a source is over-confident."""
MOST_SQUARE: Final = 15.0
"""A squared innovation counts so much at most, so that two or three jumps are not taken for it."""
TELLING: Final = 95.0
"""Sum of the window beyond which it is. An honest one's is 36.3 with a deviation of 7.8, nearly
chi-squared (of 43 degrees of freedom after scaling), which is beyond 90 as rarely as a normal
number beyond 5 deviations (Wilson and Hilferty, 1931)."""
QUIETING: Final = 60.0
"""Below it is not over-confident any more: 3 deviations."""
HONEST_THIRD: Final = 0.41
"""A third of an honest source's squared innovations, the smaller one of those against the two poses
before, lie below. So do a third of two tracks', if one is honest."""
LEAST_INFLATION: Final = 1.5
"""With less no source is over-confident; a ghost's poses may be as far off as they like."""
MOST_INFLATION: Final = 30.0
"""Beyond this it is not noise any more: one solver stated a twentieth of its true deviation."""
HEADINGS: Final = 3
"""So many headings in a row beyond their gate, against each of the two level ones before: by chance
once in 2e7 poses, where the car's own turning does not make it rarer still."""
RESTART_POSES: Final = 3
"""A new place is believed after so many poses at least, as by the trace that they are added to."""
LATELY: Final = 12
"""Of so many poses heard last ..."""
RETURNS: Final = 2
"""... the first of the believed ones after a refused one come so often: they are a ghost's."""
FORGOTTEN: Final = 3 * SECOND
"""Poses that were refused longer ago than this (ns) say nothing of a new one."""


class Belief(NamedTuple):
    """What to make of a pose: whether to use it, why not, how exact it is.

    `reason` is "over-confident" of poses that are believed, but not their accuracy; `deviation` (m,
    per axis) is what to assume instead.
    """

    believed: bool
    reason: Distrust
    deviation: float


class InnovationGate:
    """Judges the poses of one source in the order in which they are heard.

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
        self._believed: PoseTrack | None = None
        self._level: deque[Fix] = deque(maxlen=2)
        self._twisted = 0
        self._suspect: PoseTrack | None = None
        self._suspected: Distrust = ""
        self._agreed = 0
        self._agreed_since = 0
        self._lately: deque[bool] = deque(maxlen=LATELY)
        self._heard: deque[Fix] = deque(maxlen=2)
        self._known: tuple[Fix, Fix, Innovation] | None = None
        self._squares: deque[float] = deque(maxlen=WINDOW)
        self._counted: deque[float] = deque(maxlen=WINDOW)
        self._inflation = 1.0
        self._place: Fix | None = None
        self._claimed = (0.0, 0.0, 0.0)
        self.refused: Counter[Distrust] = Counter()

    def judge(self, now: int, fix: Fix) -> Belief:
        """Judge a pose heard at `now` (ns) by its innovations (Kalman filter)."""
        if not isfinite(fix.east + fix.north + fix.yaw + fix.speed + fix.yaw_rate):
            return self._refuse(fix, "impossible")
        frozen = self._listen(fix)
        if self._believed is None:
            self._start(PoseTrack(fix, self._inflation))
            return self._believe(fix)
        before = self._believed.last
        one, turn = self._against(before, fix), turned(before, fix, self._noise)
        reason: Distrust = "frozen" if frozen else self._fault(self._believed, one, turn, fix)
        if one.span <= 0.0:
            return self._refuse(fix, reason) if reason else self._believe(fix)
        reason = reason or self._twist(turn, fix)
        if not reason:
            self._believed.push(one, fix, self._inflation)
            self._agreed = 0
            self._lately.append(True)
            return self._believe(fix)
        self._lately.append(False)
        ghost = reason != "frozen" and self._alternates
        return self._doubt(now, fix, "ghost" if ghost else reason)

    @property
    def _alternates(self) -> bool:
        """Whether poses have been believed and refused in turn, so that there are two tracks."""
        returns = sum([after and not before for before, after in pairwise(self._lately)])
        return returns >= RETURNS

    def _against(self, before: Fix, fix: Fix) -> Innovation:
        """Innovation against another pose: mostly the same one is believed and heard last."""
        if self._known is None or self._known[0] is not before or self._known[1] is not fix:
            self._known = before, fix, innovation(before, fix, self._noise)
        return self._known[2]

    def _believe(self, fix: Fix) -> Belief:
        reason: Distrust = "over-confident" if self._inflation > 1.0 else ""
        return Belief(True, reason, self._deviation(fix))

    def _refuse(self, fix: Fix, reason: Distrust) -> Belief:
        self.refused[reason] += 1
        return Belief(False, reason, self._deviation(fix))

    def _deviation(self, fix: Fix) -> float:
        """What to assume of a pose's accuracy (m)."""
        if self._inflation == 1.0:
            return fix.accuracy
        return min(self._inflation * max(fix.accuracy, LEAST_DEVIATION), MOST_DEVIATION)

    def _start(self, track: PoseTrack) -> None:
        """Believe in a track from now on."""
        self._believed, self._suspect = track, None
        self._level.clear()
        self._level.append(track.last)
        self._twisted = 0

    def _fault(self, track: PoseTrack, one: Innovation, turn: float, fix: Fix) -> Distrust:
        """What is wrong with a pose, held against a track."""
        if one.deviations(self._inflation) > self._gate:
            return "jumping"
        if gained(track.last, fix, self._noise) > self._gate:
            return "impossible"
        if one.span > 0.0 and (
            track.strays(one, fix, self._inflation) > self._gate
            or track.cornering(fix) > CORNERING + self._gate * fix.speed * self._noise.heading
        ):
            return "impossible"
        return "jumping" if turn > self._gate else ""

    def _twist(self, turn: float, fix: Fix) -> Distrust:
        """Whether the heading has been wrong several times in a row."""
        if not self._twisted and turn <= self._heading_gate:
            self._level.append(fix)
            return ""
        turns = (turned(before, fix, self._noise) for before in self._level)
        if min(turns) <= self._heading_gate:
            self._level.append(fix)
            self._twisted = 0
            return ""
        self._twisted += 1
        return "jumping" if self._twisted >= HEADINGS else ""

    def _doubt(self, now: int, fix: Fix, reason: Distrust) -> Belief:
        """Refuse a pose, unless it is the last one of those that make a new place."""
        track = self._suspect
        if track is not None and fix.measured_at - track.last.measured_at > FORGOTTEN:
            track = None
        if track is not None:
            one = innovation(track.last, fix, self._noise)
            turn = turned(track.last, fix, self._noise)
            if reason == "frozen" or self._fault(track, one, turn, fix):
                track = None
            elif one.span > 0.0:
                track.push(one, fix, self._inflation)
        if track is None:
            self._suspect, self._suspected = PoseTrack(fix, self._inflation), reason
            self._agreed, self._agreed_since = 1, now
            return self._refuse(fix, reason)
        if not self._agreed:
            self._agreed_since = now
        self._agreed += 1
        if self._agreed >= RESTART_POSES and now - self._agreed_since >= self._settle:
            self._start(track)
            return self._believe(fix)
        return self._refuse(fix, "ghost" if reason == "ghost" else self._suspected)

    def _listen(self, fix: Fix) -> bool:
        """Learn from a pose, believed or not, how exact and how frozen its source is."""
        if not self._heard:
            self._heard.append(fix)
            self._place = fix
            return False
        one = self._against(self._heard[-1], fix)
        if one.span <= 0.0:
            return False
        frozen = self._stays(one, fix)
        if not frozen:
            square = one.square()
            if len(self._heard) > 1:
                square = min(square, innovation(self._heard[0], fix, self._noise).square())
            self._squares.append(square)
            self._counted.append(MOST_SQUARE if square > MOST_SQUARE else square)
            self._inflate()
        self._heard.append(fix)
        return frozen

    def _stays(self, one: Innovation, fix: Fix) -> bool:
        """Whether the place stays where it was although the speed told must have moved it."""
        place = self._place or fix
        limit = (
            self._gate
            * self._inflation
            * sqrt(stated_variance(place.accuracy) + stated_variance(fix.accuracy))
        )
        if hypot(fix.east - place.east, fix.north - place.north) > limit:
            self._place, self._claimed = fix, (0.0, 0.0, 0.0)
            return False
        if fix.speed > self._gate * self._noise.speed:
            east, north, variance = self._claimed
            along, across, way = one.along_variance, one.across_variance, one.way
            variance += across if across > along else along
            self._claimed = east + way[0], north + way[1], variance
        east, north, variance = self._claimed
        return hypot(east, north) > 2.0 * limit + self._gate * sqrt(variance)

    def _inflate(self) -> None:
        """Take the source's accuracy for worse than stated while its innovations say so."""
        size = sum(self._counted)
        if size > (TELLING if self._inflation == 1.0 else QUIETING):
            third = sorted(self._squares)[len(self._squares) // 3]
            inflation = min(sqrt(third / HONEST_THIRD), MOST_INFLATION)
            self._inflation = inflation if inflation >= LEAST_INFLATION else 1.0
        else:
            self._inflation = 1.0
