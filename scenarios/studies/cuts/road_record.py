"""What happened to the cars of a run on the road: errors, departures from the lane, collisions."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from scenarios.results.events.encounters import Episode
from scenarios.results.stream import FigureStream
from scenarios.studies.cuts.received_path import Delivery, StationTrack, judge_departures
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import GpsPose, LinkVerdict, Message, TruePose
from vehicles.schedule import nanoseconds


@dataclass(slots=True)
class CarRecord:
    """True poses of a car, deliveries, errors and stations by instant (ns), and its events."""

    truth: list[TruePose] = field(default_factory=list)
    deliveries: list[Delivery] = field(default_factory=list)
    errors: dict[int, float] = field(default_factory=dict)
    stations: dict[int, float] = field(default_factory=dict)
    departures: list[int] = field(default_factory=list)
    collisions: int = 0
    """Number of collisions with a car ahead."""

    def track(self) -> StationTrack:
        """Motion along the lead's path; that of the lead itself has no errors."""
        poses = [
            pose for pose in self.truth if not self.stations or pose.true_at_ns in self.stations
        ]
        rows = [
            (
                pose.true_at_ns,
                self.stations.get(pose.true_at_ns, pose.distance_m),
                self.errors.get(pose.true_at_ns, 0.0),
                pose.speed_mps,
            )
            for pose in poses
        ]
        return StationTrack(*np.array(rows, dtype=float).reshape(-1, 4).T)


class RoadObserver:
    """Observer of a run that records its cars on the road."""

    kinds: frozenset[type[Message]] = frozenset((GpsPose, LinkVerdict, TruePose))

    def __init__(self, stream: FigureStream) -> None:
        self._since: dict[tuple[str, int], int] = {}
        self.cars: defaultdict[str, CarRecord] = defaultdict(CarRecord)
        stream.on_error(self._record_error)
        stream.on_event(self._record_event, ("lane_departure", "collision"))

    def _record_error(self, foot: CrossTrack) -> None:
        self.cars[foot.vehicle].errors[foot.at_ns] = foot.lateral
        self.cars[foot.vehicle].stations[foot.at_ns] = foot.station

    def _record_event(self, episode: Episode) -> None:
        car = self.cars[episode.vehicles[-1]]
        if episode.kind == "collision":
            car.collisions += 1
        else:
            car.departures.append(episode.at_ns)

    def listen(self, _at: int, message: Message) -> None:
        car = self.cars[message.vehicle]
        if isinstance(message, TruePose):
            car.truth.append(message)
        elif isinstance(message, GpsPose):
            history_s = sum(message.history_age_cs) / 100.0
            since = message.measured_at_ns - nanoseconds(history_s)
            self._since[message.vehicle, message.seq] = since
        elif isinstance(message, LinkVerdict) and message.outcome == "delivered":
            since = self._since[message.sender, message.pose_seq]
            received_at, measured_at = message.received_at_ns, message.measured_at_ns
            car.deliveries.append(Delivery(received_at, message.sender, measured_at, since))

    def avoidable_departures(self) -> Mapping[str, int]:
        """Count for each car the departures for which the received path sufficed to stop."""
        tracks = {name: car.track() for name, car in self.cars.items()}
        return {
            name: sum(judge_departures(car.departures, tracks[name], tracks, car.deliveries))
            for name, car in self.cars.items()
        }
