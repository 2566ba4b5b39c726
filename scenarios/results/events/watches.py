"""Events of followers that degrade: a stop, and a source that is not believed."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from math import isfinite

from scenarios.results.events.encounters import Episode
from vehicles.messages import Tracking
from vehicles.schedule import SECOND

NOWHERE = (0.0, 0.0)


class StopWatch:
    """Stops of followers that know too little of the road, each until it drives on."""

    def __init__(self) -> None:
        self._open: dict[str, Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = NOWHERE) -> Iterable[Episode]:
        """Take the tracking of one instant; gives each stop as it begins."""
        if tracking.mode == "stop":
            return self._stopping(tracking, place)
        if self._open:
            self._open.pop(tracking.vehicle, None)
        return ()

    def _stopping(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        episode = self._open.get(name)
        if episode is None:
            episode = self._open[name] = Episode("stop", (name,), at, at, place=place)
            figures = {"known_m": tracking.known_m, "predicted_blind_m": tracking.blind_m}
            episode.figures |= {name: one for name, one in figures.items() if isfinite(one)}
            yield episode
        episode.until_ns = at
        episode.most("duration_s", (at - episode.at_ns) / SECOND)


class TrustWatch:
    """Sources that a follower does not believe, each until it does again."""

    def __init__(self, names: Sequence[str]) -> None:
        """Take the names of the convoy, the lead first."""
        self._lead = names[0]
        self._ahead = {behind: ahead for ahead, behind in pairwise(names)}
        self._open: dict[tuple[str, str], Episode] = {}

    def add(self, tracking: Tracking, place: tuple[float, float] = NOWHERE) -> Iterable[Episode]:
        """Take the tracking of one instant; gives each source as it begins to be distrusted."""
        if (
            self._open
            or tracking.lead_status == "distrusted"
            or tracking.predecessor_status == "distrusted"
        ):
            return self._doubting(tracking, place)
        return ()  # as nearly always

    def _doubting(self, tracking: Tracking, place: tuple[float, float]) -> Iterator[Episode]:
        name, at = tracking.vehicle, tracking.decided_at_ns
        ahead = self._ahead.get(name)
        if ahead is None:  # the lead has no sources
            return
        statuses = {self._lead: tracking.lead_status}
        if ahead != self._lead:
            statuses[ahead] = tracking.predecessor_status
        for source, status in statuses.items():
            pair = source, name
            if status != "distrusted":
                self._open.pop(pair, None)
                continue
            episode = self._open.get(pair)
            if episode is None:
                found = Episode("distrust", pair, at, at, place=place)
                episode = self._open[pair] = found
                yield episode
            episode.until_ns = at
            episode.most("duration_s", (at - episode.at_ns) / SECOND)
