"""The sources of a follower: lead and predecessor, which are one for the first follower."""

from collections.abc import Iterable, Mapping
from math import isnan, nan

from vehicles.driver.degradation.meant_path import MeantPath, MeantShare
from vehicles.driver.degradation.settings import Braking, DegradationSettings
from vehicles.driver.degradation.situation import Situation
from vehicles.driver.degradation.source import RELIED_ON, Source, reaches_ahead
from vehicles.driver.degradation.stopping import stopping_distance
from vehicles.driver.ego.own_state import Pose
from vehicles.messages import Mode
from vehicles.preview.trace import Window
from vehicles.preview.trajectory import FitSettings, Fusion
from vehicles.schedule import SECOND

HOPED_FOR = ("unheard", *RELIED_ON)
"""Statuses of a source that a trajectory may yet be made of."""


class SourcePair:
    """Lead and predecessor (Section III-A), and which of them make the trajectory.

    `used` are those, by the mode of a follower that steers along one alone; `relied` are those of
    them that were relied on at the last look.
    """

    def __init__(
        self, lead: Source, predecessor: Source, fusion: Fusion, settings: DegradationSettings
    ) -> None:
        """`lead` and `predecessor` are one object for the first follower, whatever the fusion."""
        self.lead = lead
        self.predecessor = predecessor
        self.all = {one.name: one for one in (lead, predecessor)}
        self.used: dict[Mode, Source] = {}
        self.relied: dict[Mode, Source] = {}
        if fusion != "predecessor" or lead is predecessor:
            self.used["lead"] = lead
        if lead is not predecessor:
            self.used["predecessor"] = predecessor
            predecessor.may_stray = len(self.used) > 1 and settings.reaction == "degrade"
        wanted = predecessor.may_stray and settings.predecessor_path == "meant"
        if wanted:
            predecessor.meant = MeantPath()
        self._meant = MeantShare(settings.probation, wanted=wanted)
        self._degrades = settings.reaction == "degrade"
        self._comfortable, self._firm = settings.comfortable, settings.firm
        self._hardest = settings.hardest
        self._looked_at = 0
        self._alone_at = 0

    def windows(self, pose: Pose, settings: FitSettings, *, runs_out: bool) -> dict[Mode, Window]:
        """Samples around the ego of sources that reach ahead of it (preview data, Section III-A).

        While the known path `runs_out`, more of it behind makes up for what is missing ahead, so
        that the curve is no less certain where it has to be held.
        """
        behind, ahead = settings.behind(pose.speed), settings.ahead(pose.speed)
        windows: dict[Mode, Window] = {}
        for mode, source in self.used.items():
            known = source.freshness.known
            known = 0.0 if isnan(known) else known
            more = min(max(ahead - known, 0.0), ahead) if runs_out else 0.0
            window = source.window(pose.east, pose.north, behind + more, ahead)
            if window is not None:
                windows[mode] = window
        return self._as_meant(self._without_guesses(windows, behind))

    def have_guesses(self, windows: Mapping[Mode, Window]) -> bool:
        """Whether some of the samples cut out last bridge what was never received."""
        return any(self.used[mode].trace.has_guesses(window) for mode, window in windows.items())

    def received(self, windows: Mapping[Mode, Window]) -> int:
        """Number of samples of these sources since their traces began (Section III-A)."""
        return sum([self.used[mode].trace.heard for mode in windows])

    def _as_meant(self, windows: dict[Mode, Window]) -> dict[Mode, Window]:
        """Bring the predecessor's samples to the path that it meant, while it alone is followed."""
        window, source = windows.get("predecessor"), self.predecessor
        if window is not None and source.meant is not None and self._meant.now > 0.0:
            instants = source.trace.instants(window)
            windows["predecessor"] = source.meant.of(window, instants, self._meant.now)
        return windows

    def _without_guesses(self, windows: dict[Mode, Window], behind: float) -> dict[Mode, Window]:
        """Leave out what bridges holes where a source that counts has the path beside the car.

        That is up to `behind` (m) in front of it and behind it: inside of a longer hole a bridge is
        the better guess. Where none behind count, as by the paper's own rules, only the path ahead
        is needed.
        """
        told: dict[Mode, Window] = {}
        bridged = False
        for mode, window in windows.items():
            told[mode] = self.used[mode].trace.told(window)
            bridged = bridged or told[mode] is not window
        if not bridged:  # the usual case
            return windows
        told = {mode: window for mode, window in told.items() if reaches_ahead(window)}
        if behind == 0.0:
            return told or windows
        for mode, window in told.items():
            passed = int(window.station.searchsorted(0.0, "right"))
            beside = window.station[max(passed - 1, 0) : passed + 1].tolist()
            if self.used[mode].weight and -behind <= beside[0] <= 0.0 <= beside[-1] <= behind:
                return told
        return windows

    def steer_along(self, mode: Mode, span: float) -> None:
        """Steer along `mode` for `span` (s), which may bring in the path that was meant.

        Beyond the paper, whose followers without lead data follow the way driven (Section V-D.1).
        """
        self._meant.go_on(mode, span)

    def alpha(self, alpha: float) -> float:
        """Weight of the predecessor, α of eq. (5), by what is left of both sources' weights."""
        lead, ahead = self.lead.weight, self.predecessor.weight
        if lead == ahead or lead + ahead == 0.0:
            return alpha
        total = (1.0 - alpha) * lead + alpha * ahead
        return alpha * ahead / total if total > 0.0 else alpha

    def look(self, now: int, pose: Pose, acceleration: float, *, refit: bool) -> Situation:
        """Judge all sources at a control instant `now` (ns), after `acceleration` (m/s²) was asked.

        How far the path is known is measured at a `refit`, and follows from the speed otherwise.
        """
        span = (now - self._looked_at) / SECOND if self._looked_at else 0.0
        self._looked_at = now
        speed = pose.speed
        driven = 0.0 if refit else speed * span
        for source in self.all.values():
            if refit:
                source.locate(pose.east, pose.north)
            source.look(now, driven, span)
        known = nan
        self.relied = {}
        for mode, source in self.used.items():
            seen = source.freshness
            if seen.status != "distrusted" and (isnan(known) or seen.known > known):
                known = seen.known
            if source.usable and seen.status in RELIED_ON:
                self.relied[mode] = source
        comfortable = _stop(speed, acceleration, self._comfortable)
        firm = _stop(speed, acceleration, self._firm)
        blind = _stop(speed, acceleration, self._hardest, period=span) - known
        blind = 0.0 if blind < 0.0 else blind
        lead, predecessor = self.lead.freshness, self.predecessor.freshness
        return Situation(lead, predecessor, known, comfortable, firm, blind)

    @property
    def run_out(self) -> bool:
        """Whether none that is relied on extends the known path any further."""
        return all(source.runs_out for source in self.relied.values())

    def stops_at(self, mode: Mode, brakes_at: int) -> int:
        """Instant (ns) from which a car that steers along `mode` stops, unless it receives more.

        0 if nothing requires it. That is when the last source that it relies on, or waits for, is
        lost, as soon as a message of each is overdue; or when its guard has to brake behind the
        predecessor (`brakes_at`, 0 for not); and not later than the predecessor's, behind which it
        stops too.
        """
        if not self._degrades:
            return 0
        hopes: Iterable[Source] = self.relied.values()
        if not self.relied:
            hopes = [one for one in self.used.values() if one.status in HOPED_FOR]
        lost_at, misses_all = 0, mode != "coast"
        for one in hopes:
            lost_at = max(lost_at, one.freshness.lost_at)
            misses_all = misses_all and one.is_missed
        self._alone_at = lost_at or self._alone_at
        earliest = self._alone_at if misses_all else 0
        for at in (brakes_at, self.predecessor.freshness.stops_at):
            if at and (at < earliest or not earliest):
                earliest = at
        return earliest


def _stop(speed: float, acceleration: float, braking: Braking, period: float = 0.0) -> float:
    """Braking distance (m); a car that brakes harder already would not release the brake first.

    Commands that are held for a `period` (s) are on average half a period ahead of the ramp of the
    jerk: at 30 m/s and 50 Hz that is 0.3 m.
    """
    sooner = acceleration - 0.5 * braking.jerk * period
    hardest = -braking.deceleration
    return stopping_distance(speed, hardest if hardest > sooner else sooner, braking)
