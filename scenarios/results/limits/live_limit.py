"""A limit followed through a running simulation, rather than judged by its summary."""

from collections.abc import Sequence
from math import inf

from scenarios.definition.run_limits import Limit
from scenarios.results.events.encounters import Episode, TrueGap
from scenarios.results.stream import ALL_EVENTS, FigureStream
from vehicles.geometry.driven_path import CrossTrack


class LiveLimit:
    """Subscribes to the figure of a limit: is it `broken` by now, and how near did the run come.

    A limit is broken in the same runs as by `broken_by` of their summaries. The stream computes
    nothing but what the limit depends on, unless others subscribe to it.
    """

    def __init__(
        self,
        limit: Limit,
        stream: FigureStream,
        vehicles: Sequence[str],
        *,
        with_excess: bool = True,
    ) -> None:
        """Subscribe to the stream of a convoy of `vehicles`, lead first.

        Without `with_excess` only the breach is of interest.
        """
        self.limit = limit
        self.broken = False
        self._events = 0
        self._excess = -inf
        place = vehicles.index(limit.vehicle) if limit.vehicle else 0
        both_gaps = vehicles[place : place + 2] if limit.row.event else (limit.vehicle,)
        self._gaps_of = both_gaps if limit.vehicle else vehicles
        stream.on_event(self._take_event, [kind for kind in ALL_EVENTS if kind == limit.row.event])
        match limit.row.live if limit.row.figure or with_excess else "":
            case "lane_excess":
                stream.on_lane_excess(self._take_lane_excess)
            case "error":
                stream.on_error(self._take_error)
            case "gap":
                stream.on_gap(self._take_gap)

    def latest_excess(self) -> float:
        """Largest excess since the last call; negative while the limit held, -inf without any."""
        excess, self._excess = self._excess, -inf
        return excess

    def _take_event(self, event: Episode) -> None:
        if self.limit.vehicle in {"", *event.vehicles}:
            self._events += 1
            self.broken |= self._events > self.limit.bound

    def _take_lane_excess(self, vehicle: str, excess: float) -> None:
        if self.limit.vehicle in {"", vehicle}:
            self._excess = max(self._excess, excess)

    def _take_error(self, foot: CrossTrack) -> None:
        if self.limit.vehicle in {"", foot.vehicle}:
            self._judge(abs(foot.lateral))

    def _take_gap(self, gap: TrueGap) -> None:
        if gap.vehicle not in self._gaps_of:
            return
        if self.limit.row.event:
            self._excess = max(self._excess, -gap.now_m)
        else:
            self._judge(gap.now_m)

    def _judge(self, figure: float) -> None:
        excess = self.limit.excess(figure)
        self._excess = max(self._excess, excess)
        self.broken |= excess > 0.0
