"""Events of single vehicles: lost paths, slides, stops, and distrusted sources."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import isfinite
from typing import Protocol

from scenarios.results.events.encounters import Episode
from vehicles.messages import Tracking, TruePose
from vehicles.schedule import SECOND, nanoseconds

ORIGIN = (0.0, 0.0)
LOST_MODES = frozenset({"coast", "stop", "straight"})
"""Modes of a follower that has no trajectory from what it received, unless it knows the road."""
UNRECORDED_NS = SECOND // 2
"""Longest time between two tracking messages of one episode; the slowest control runs at 5 Hz."""


class TrackingWatch(Protocol):
    """Finds events of followers in their tracking."""

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        """Take the tracking of one instant at a place (m); yields each event as it begins."""
        ...


class PathWatch:
    """Followers that had a trajectory and steer without one for longer than `after` (s).

    A follower that continues along a known road has not lost its path.
    """

    def __init__(self, after: float) -> None:
        self._after = nanoseconds(after)
        self._lost: dict[str, Episode | None] = {}
        self._last: dict[str, int] = {}
        self._reported: set[str] = set()

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        """Take the tracking of one instant at a place (m); yields a loss after `after` (s)."""
        name, at = tracking.vehicle, tracking.decided_at_ns
        before, self._last[name] = self._last.get(name, at), at
        if tracking.mode not in LOST_MODES or tracking.known_m > 0.0:  # false for NaN
            self._lost[name] = None
            if self._reported:
                self._reported.discard(name)
        elif name in self._lost:  # it had a trajectory before
            return self._note_loss(name, at, place, unseen=at - before > UNRECORDED_NS)
        return ()

    def _note_loss(
        self, name: str, at: int, place: tuple[float, float], *, unseen: bool
    ) -> Iterator[Episode]:
        episode = self._lost[name]
        if episode is None or unseen:
            episode = self._lost[name] = Episode("path_lost", (name,), at, at, place=place)
            self._reported.discard(name)
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)
        if name not in self._reported and at - episode.at_ns > self._after:
            self._reported.add(name)
            yield episode


class SlideWatch:
    """Vehicles with an axle that uses all available friction, or more with linear tyres."""

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, pose: TruePose) -> Iterator[Episode]:
        """Take a pose in which the vehicle slides; yields each slide as it begins."""
        name, at = pose.vehicle, pose.true_at_ns
        episode = self._open.get(name)
        if episode is None or episode.is_over(at):
            place = (pose.east_m, pose.north_m)
            episode = self._open[name] = Episode("slide", (name,), at, at, place=place)
            yield episode
        episode.until_ns = at
        episode.most("slip_rad_max", max(abs(pose.front_slip_rad), abs(pose.rear_slip_rad)))
        episode.most("friction_ratio_max", pose.friction_ratio)
        episode.most("duration_s", (at - episode.at_ns) / SECOND)


class StopWatch:
    """Stops of cars that know too little of the road ahead, each until it drives again.

    Those of a lead begin when it stands behind a member of its convoy that is silent.
    """

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        if tracking.mode == "stop" or (
            tracking.mode == "path" and tracking.predecessor_status == "lost"
        ):
            return self._note_stop(tracking, place)
        if self._open:
            self._open.pop(tracking.vehicle, None)
        return ()

    def _note_stop(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        episode = self._open.get(name)
        if episode is None:
            episode = self._open[name] = Episode("stop", (name,), at, at, place=place)
            figures = {"known_m": tracking.known_m, "predicted_blind_m": tracking.blind_m}
            episode.figures |= {name: value for name, value in figures.items() if isfinite(value)}
            yield episode
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)


class TrustWatch:
    """Sources that a follower distrusts, each until it is trusted again."""

    def __init__(self, names: Sequence[str]) -> None:
        self._lead = names[0]
        self._ahead = {behind: ahead for ahead, behind in pairwise(names)}
        self._open: dict[tuple[str, str], Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = ORIGIN) -> Iterable[Episode]:
        if (
            self._open
            or tracking.lead_status == "distrusted"
            or tracking.predecessor_status == "distrusted"
            or "distrusted" in tracking.other_sources
        ):
            return self._note_distrust(tracking, place)
        return ()  # the usual case

    def _note_distrust(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        ahead = self._ahead.get(name)
        if ahead is None:  # the lead has no sources
            return
        statuses = {self._lead: tracking.lead_status}
        if ahead != self._lead:
            statuses[ahead] = tracking.predecessor_status
        statuses |= tracking.statuses()
        for source, status in statuses.items():
            pair = source, name
            if status != "distrusted":
                self._open.pop(pair, None)
                continue
            episode = self._open.get(pair)
            if episode is None:
                begun = Episode("distrust", pair, at, at, place=place)
                episode = self._open[pair] = begun
                yield episode
            episode.until_ns = at
            episode.most("duration_s", (at - episode.at_ns) / SECOND)
