"""One source of a follower: its trace, how fresh it is, and what is made of it."""

from math import isnan, nan
from typing import Final

from vehicles.car.gnss import Fix
from vehicles.driver.degradation.meant_path import MeantPath
from vehicles.driver.degradation.probation import Probation
from vehicles.driver.degradation.reception import RECENT, Reception
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.degradation.situation import SourceFreshness
from vehicles.driver.degradation.trust.gate import Belief
from vehicles.messages import GpsPose, SourceStatus
from vehicles.preview.trace import Trace, Window
from vehicles.schedule import SECOND

RELIED_ON = ("fresh", "late")
"""A source of such a status is steered along and counted on."""
MISSED_AFTER: Final = 1.5
"""A message is overdue after so many times what usually lies between two that come."""
LEAST_SHARE: Final = 0.05
"""A source is expected to deliver this share of its messages at least."""
LEAST_SAMPLES: Final = 3
"""Fewer samples of a source than these determine no trajectory."""


def is_astray(message: GpsPose) -> bool:
    """Whether a vehicle says that it may not be on the path: it warns, or hears nobody itself.

    Beyond the paper, whose vehicles always know the path.
    """
    return message.hazard or message.mode in ("coast", "stop")


class Source:
    """A vehicle that a follower hears: what it told, how long ago, and whether to rely on it.

    Beyond the paper, whose sources always come through. Its status: unheard, fresh, late when some
    messages are overdue, lost after a longer silence, distrusted while what it says is refused, on
    probation once it is heard and believed again. Its `weight` in the trajectory is 1 as long as it
    is fresh; from when it is late it fades with the path that is left of it, and comes back slowly,
    so that no sample comes or goes at once. One that `may_stray` is followed only while it does not
    say so: there is another one, whose path is meant.
    """

    def __init__(
        self, name: str, period: float, settings: DegradationSettings, delay: float = 0.0
    ) -> None:
        """`period` (s) is that between messages, `delay` (s) how long one takes to come.

        Both as far as they are known beforehand; the delay counts for the first one alone.
        """
        self.name = name
        self.trace = Trace()
        self.meant: MeantPath | None = None
        self.weight = 1.0
        self.usable = False
        self.reaches = False
        self.refusal = ""
        self.may_stray = False
        self._strayed = False
        self.probation = Probation(settings)
        self._settings = settings
        self._reception = Reception(period)
        self._degrades = settings.reaction == "degrade"
        self._refused_at: int | None = None
        self._now = SourceFreshness()
        self._period = period
        self._delay = round(delay * SECOND)
        self._due_from: int | None = None
        self._waited = 0.0
        self._known = nan
        self._known_of_all = 0.0

    @property
    def status(self) -> SourceStatus:
        """What is made of it."""
        return self._now.status

    @property
    def known(self) -> float:
        """How far its path is known ahead of the car (m), when last looked at; NaN before."""
        return self._now.known

    @property
    def relied_on(self) -> bool:
        """Whether it is heard as it should be, and a trajectory was made of it before."""
        return self.usable and self._now.status in RELIED_ON

    @property
    def freshness(self) -> SourceFreshness:
        """How fresh it was when last looked at."""
        seen = self._now
        return SourceFreshness(
            seen.status,
            seen.age,
            seen.silence,
            seen.period,
            seen.share,
            seen.known,
            seen.mode,
            seen.hazard,
            seen.acceleration,
            seen.lost_at,
            seen.stops_at,
        )

    @property
    def lost_at(self) -> int:
        """When it is lost (ns) unless it is heard again, as of the last look."""
        return self._now.lost_at

    @property
    def stops_at(self) -> int:
        """When it begins to stop (ns), as it announced last, or 0."""
        return self._now.stops_at

    @property
    def runs_out(self) -> bool:
        """Whether it tells no more of the road: it is late or astray."""
        return self._now.status == "late" or self._strayed

    @property
    def is_missed(self) -> bool:
        """Whether a message of it is overdue, long before it counts as late."""
        if self._now.status == "unheard":
            return self._waited > MISSED_AFTER * self._period
        share = self._reception.usual_share
        usual = self._now.period / (LEAST_SHARE if share < LEAST_SHARE else share)
        return self._now.silence > MISSED_AFTER * usual

    @property
    def never_came(self) -> bool:
        """Whether it was never heard in the time in which others are lost."""
        after = self._settings.lost_after_silence(self._period)
        return self._now.status == "unheard" and self._waited > after

    def hear(self, now: int, fix: Fix, message: GpsPose, belief: Belief) -> None:
        """Take a message heard at `now` (ns) to its trace, if it is believed (Section III-A)."""
        newest = self.trace.newest_at is None or fix.measured_at > self.trace.newest_at
        if not belief.believed:
            self._refused_at, self.refusal = now, belief.reason
            return
        lost = newest and self._now.is_lost
        place = fix.measured_at, fix.east, fix.north, fix.yaw, fix.speed
        if self.may_stray and is_astray(message) and self.trace.newest is not None:
            self._strayed = True
            self.trace.pass_over(*place)
        else:
            # Baselines know no holes: what they hear after a silence is one more sample to them.
            hole = (lost and self._degrades) or (newest and self._strayed)
            self._strayed &= not newest
            self.trace.add(*place, after_hole=hole)
            if self.meant is not None:
                self.meant.tell(fix, message.path_offset_m)
        if lost:
            self._reception.forget()
        if newest and self.trace.newest_at != fix.measured_at:
            self._refused_at, self.refusal = now, "a jump"
        elif self._reception.add(now, fix.measured_at, message.seq):
            self._heard_anew(now, message)

    def _heard_anew(self, now: int, message: GpsPose) -> None:
        seen = self._now
        seen.mode, seen.hazard = message.mode, message.hazard
        seen.acceleration = message.acceleration_mps2
        seen.stops_at = message.stops_at_ns
        if seen.status == "unheard":
            seen.status = "fresh"
        elif seen.is_lost:
            self.probation.begin(now)
            seen.status = "probation"

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window | None:
        """Samples around the ego at (east, north), None if they do not reach ahead of it.

        The preview data of Section III-A, from `behind` to `ahead` (m).
        """
        window = self.trace.window(east, north, behind, ahead)
        self.reaches = reaches_ahead(window)
        self.usable |= self.reaches
        return window if self.reaches else None

    def locate(self, east: float, north: float) -> None:
        """Measure how far its path is known ahead of the ego at (east, north)."""
        self._known = self.trace.known(east, north)

    def look(self, now: int, driven: float, span: float) -> None:
        """Judge it at a control instant `now` (ns), `span` (s) and `driven` (m) after the last.

        By silence, not by age, so that a latency alone makes nobody lost.
        """
        seen, reception, at = self._now, self._reception, self.trace.newest_at
        self._known -= driven
        seen.known = self._known
        if at is None:
            self._wait(now)
            return
        seen.age = (now - at) / SECOND
        seen.silence = reception.silence(now)
        seen.period = reception.period
        seen.share = reception.share(now)
        self._judge(now)
        if self._degrades:
            self._weigh(span)

    def _wait(self, now: int) -> None:
        """Wait for its first message, as long as for any later one."""
        if self._due_from is None:
            self._due_from = now + self._delay
        self._waited = (now - self._due_from) / SECOND
        after = self._settings.lost_after_silence(self._period)
        self._now.lost_at = self._due_from + round(after * SECOND)

    def _judge(self, now: int) -> None:
        """Lost and distrusted at once, relied on again only after probation."""
        seen, settings = self._now, self._settings
        late = seen.silence > settings.late_periods * seen.period
        after = settings.lost_after_silence(seen.period)
        seen.lost_at = now + round((after - seen.silence) * SECOND)
        refused = self._refused_at is not None and (now - self._refused_at) / SECOND <= after
        if (late and refused) or seen.silence > after:
            if not seen.is_lost:
                self.probation.fail(now)
            seen.status = "distrusted" if refused else "lost"
            self._reception.pause_count(now)
            return
        if seen.status == "probation":
            self._serve(now)
        else:
            self._reception.count_share(now, seen.share)
        if seen.status != "probation":
            seen.status = "late" if late else "fresh"

    def _serve(self, now: int) -> None:
        """Let it come back; what it usually delivers may be less by now, so that it always can."""
        served = self.probation.served(now)
        if served * SECOND < RECENT:
            self._reception.pause_count(now)
        else:
            self._reception.count_share(now, self._now.share)
        share = self._settings.trusted_share
        if served >= self.probation.length and self._reception.delivers(now, share):
            self.probation.end(now)
            self._now.status = "fresh"

    def _weigh(self, span: float) -> None:
        """Let the weight fade with the known path, and come back over the probation."""
        seen = self._now
        if seen.status in ("fresh", "probation"):
            self._known_of_all = 0.0
            if self.weight != 1.0:
                self.weight = min(self.weight + span / self.probation.length, 1.0)
            return
        if isnan(seen.known) or seen.known <= 0.0:
            self.weight = 0.0
            return
        if not self._known_of_all and self.weight > 0.0:
            self._known_of_all = seen.known / self.weight
        if self._known_of_all:
            self.weight = min(self.weight, seen.known / self._known_of_all)


def reaches_ahead(window: Window) -> bool:
    """Whether samples determine a trajectory and reach ahead of the ego (Section III-A)."""
    return len(window.station) >= LEAST_SAMPLES and window.station.item(-1) >= 0.0
