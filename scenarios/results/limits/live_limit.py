"""A limit followed through a running simulation, rather than judged by its summary."""

from collections.abc import Sequence

from scenarios.definition.run_limits import Limit
from scenarios.definition.schema.plug_ins.guards import PlugInError
from scenarios.results.events.encounters import Episode, TrueGap
from scenarios.results.limits.evaluation import unmeasured
from scenarios.results.stream import ALL_EVENTS, FigureStream, RoadError
from scenarios.results.vehicles.vehicle_figures import VehicleFigures
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Tracking, TruePose


class LiveLimit:
    """Subscribes to the figure of a limit, which is `broken` or not by now.

    A limit is broken in the same runs as by `broken_by` of their summaries. The stream computes
    nothing but what the limit depends on, unless others subscribe to it. A limit on a figure of the
    user's class is judged at the end of the run, as that figure may become smaller again. A limit
    on a gain along the string is not judged: only a whole run has it.
    """

    def __init__(self, limit: Limit, stream: FigureStream, vehicles: Sequence[str]) -> None:
        """Subscribe to the stream of a convoy of `vehicles`, lead first."""
        self.limit = limit
        self.broken = False
        self._events = 0
        self._stream = stream
        self._vehicles = {
            name: VehicleFigures(name, is_lead=name == vehicles[0])
            for name in ([limit.vehicle] if limit.vehicle else vehicles)
        }
        stream.on_event(self._take_event, [kind for kind in ALL_EVENTS if kind == limit.row.event])
        match limit.row.live:
            case "error":
                stream.on_error(self._take_error)
            case "gap":
                stream.on_gap(self._take_gap)
            case "road_error":
                stream.on_road_error(self._take_road_error)
            case "friction":
                stream.on_truth(self._take_friction)
            case "blind":
                stream.on_truth(self._take_truth)
                stream.on_tracking(self._take_tracking)
            case "self_estimate":
                stream.on_error(self._take_true_error)
                stream.on_tracking(self._take_tracking)

    def finish(self) -> None:
        """Judge a figure of the user's class; raises PlugInError if the class failed."""
        name = self.limit.row.own_figure
        for vehicle in self._vehicles if name else ():
            figures = self._stream.own.values(vehicle)
            if name not in figures:
                faults = self._stream.own.faults or [unmeasured(name, vehicle)]
                raise PlugInError(f"{self.limit}: {faults[0]}")
            figure = figures[name]
            self.broken |= figure is not None and self.limit.is_beyond(figure)

    def _take_event(self, event: Episode) -> None:
        if self.limit.vehicle in {"", *event.vehicles}:
            self._events += 1
            self.broken |= self._events > self.limit.bound

    def _take_error(self, foot: CrossTrack) -> None:
        if self.limit.vehicle in {"", foot.vehicle}:
            self._judge(abs(foot.lateral))

    def _take_gap(self, gap: TrueGap) -> None:
        if gap.vehicle in self._vehicles:
            self._judge(gap.now_m)

    def _take_road_error(self, error: RoadError) -> None:
        if error.vehicle in self._vehicles:
            self._judge(abs(error.lateral))

    def _take_friction(self, pose: TruePose) -> None:
        if pose.vehicle in self._vehicles:
            self._judge(pose.friction_ratio)

    def _take_truth(self, pose: TruePose) -> None:
        if (figures := self._vehicles.get(pose.vehicle)) is not None:
            figures.add_truth(pose)
            self._judge(figures.reaction.blind_m)

    def _take_true_error(self, foot: CrossTrack) -> None:
        if (figures := self._vehicles.get(foot.vehicle)) is not None:
            figures.add_error(foot)
            self._judge(figures.self_estimate.difference.largest)

    def _take_tracking(self, tracking: Tracking) -> None:
        figures = self._vehicles.get(tracking.vehicle)
        if figures is None or figures.is_lead:
            return
        figures.add_tracking(tracking)
        if self.limit.row.live == "blind":
            self._judge(figures.reaction.blind_m)
        else:
            self._judge(figures.self_estimate.difference.largest)

    def _judge(self, figure: float) -> None:
        self.broken |= self.limit.is_beyond(figure)
