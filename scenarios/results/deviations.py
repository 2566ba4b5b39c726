"""True errors and true gaps ten times a second, for plots of a log without this project."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from math import nan
from typing import NamedTuple

from scenarios.results.events.encounters import TrueGap
from scenarios.results.stream import FigureStream
from vehicles.geometry.driven_path import CrossTrack
from vehicles.schedule import MILLISECOND, SECOND

PERIOD_NS = 100 * MILLISECOND
PATIENCE_NS = SECOND
"""How long an error or a gap waits for its counterpart."""


class TrueDeviation(NamedTuple):
    """Offset of a follower from the lead's path, and gap to the body ahead (m); NaN if unknown."""

    vehicle: str
    at_ns: int
    error: float
    gap: float


@dataclass(slots=True)
class _Values:
    """Period of the latest value, and values that wait for their counterpart."""

    period: int = -1
    waiting: dict[int, float] = field(default_factory=dict)

    def is_next(self, at: int) -> bool:
        before, self.period = self.period, at // PERIOD_NS
        return self.period != before


class Deviations:
    """Pairs errors and gaps of equal instants, in either order.

    The first instant in each period of a vehicle counts, so the pairs do not depend on the order of
    messages of different vehicles. A value that waits for too long is passed on alone.
    """

    def __init__(self, followers: Iterable[str]) -> None:
        self._of = {name: (_Values(), _Values()) for name in followers}
        self._ready: list[TrueDeviation] = []

    @classmethod
    def of(cls, stream: FigureStream) -> "Deviations":
        """Subscribe to the errors and gaps of a stream."""
        made = cls(stream.followers)
        stream.on_error(made.take_error)
        stream.on_gap(made.take_gap)
        return made

    def take_error(self, foot: CrossTrack) -> None:
        self.add_error(foot.vehicle, foot.at_ns, foot.lateral)

    def take_gap(self, gap: TrueGap) -> None:
        if self.wants_gap(gap.vehicle, gap.now_at_ns):
            self.add_gap(gap.vehicle, gap.now_at_ns, gap.now_m)

    def add_error(self, vehicle: str, at: int, error: float) -> None:
        """Take an error (m) of a follower at instant `at` (ns)."""
        errors, gaps = self._of[vehicle]
        if errors.is_next(at):
            if at in gaps.waiting:
                self._ready.append(TrueDeviation(vehicle, at, error, gaps.waiting.pop(at)))
            else:
                errors.waiting[at] = error
            self._release_old(vehicle, at)

    def wants_gap(self, vehicle: str, at: int) -> bool:
        _, gaps = self._of[vehicle]
        return gaps.period != at // PERIOD_NS

    def add_gap(self, vehicle: str, at: int, gap: float) -> None:
        """Take a gap (m) of a follower at instant `at` (ns)."""
        errors, gaps = self._of[vehicle]
        if gaps.is_next(at):
            if at in errors.waiting:
                self._ready.append(TrueDeviation(vehicle, at, errors.waiting.pop(at), gap))
            else:
                gaps.waiting[at] = gap
            self._release_old(vehicle, at)

    def _release_old(self, vehicle: str, now: int) -> None:
        errors, gaps = self._of[vehicle]
        for at in [at for at in errors.waiting if now - at > PATIENCE_NS]:
            self._ready.append(TrueDeviation(vehicle, at, errors.waiting.pop(at), nan))
        for at in [at for at in gaps.waiting if now - at > PATIENCE_NS]:
            self._ready.append(TrueDeviation(vehicle, at, nan, gaps.waiting.pop(at)))

    def take_new(self) -> list[TrueDeviation]:
        if not self._ready:
            return []
        ready, self._ready = self._ready, []
        return ready
