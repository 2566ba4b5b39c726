"""Samples to which the followers of a logged run fit their trajectories."""

from dataclasses import dataclass
from math import atan2, cos, hypot, sin

from vehicles.geometry.geodesy import wrap_angle
from vehicles.messages import CompositeTrajectory, Message, TruePose

LEAD, PREDECESSOR = 0, 1

INITIAL_LINE_LEFT = 100.0
"""Distance (m) after which a follower has left its initial straight line.

The line replaces poses from before the start; beyond it all samples were received.
"""


@dataclass(slots=True)
class SampleFigures:
    """Largest number of samples ahead from each source, and heading error of the two-sample rule.

    `rule_error` (rad) is the largest difference between the car's true heading and the line
    through its closest and second closest sample, the paper's rule for θ_R. The true heading
    deviates from the path's by up to 0.02 rad.
    """

    lead: int = 0
    predecessor: int = 0
    rule_error: float = 0.0


class SampleCounter:
    """Observer of a run that counts the samples of every trajectory."""

    kinds: frozenset[type[Message]] = frozenset((CompositeTrajectory, TruePose))

    def __init__(self) -> None:
        self.figures = SampleFigures()
        self._pose: dict[str, TruePose] = {}

    def listen(self, _at: int, message: Message) -> None:
        if isinstance(message, TruePose):
            self._pose[message.vehicle] = message
        elif isinstance(message, CompositeTrajectory):
            ego = self._pose.get(message.vehicle)
            if ego is not None and ego.distance_m > INITIAL_LINE_LEFT:
                self._count(message, ego)

    def _count(self, trajectory: CompositeTrajectory, ego: TruePose) -> None:
        ux, uy = cos(ego.yaw_rad), sin(ego.yaw_rad)
        counts = [0, 0]
        distances = []
        places = zip(trajectory.sample_east_m, trajectory.sample_north_m, strict=True)
        for source, (east, north) in zip(trajectory.sample_source, places, strict=True):
            dx, dy = east - ego.east_m, north - ego.north_m
            counts[source] += dx * ux + dy * uy > 0.0
            distances.append((hypot(dx, dy), dx * ux + dy * uy, east, north))
        figures = self.figures
        figures.lead = max(figures.lead, counts[LEAD])
        figures.predecessor = max(figures.predecessor, counts[PREDECESSOR])
        if len(distances) < 2 or len(set(trajectory.sample_source)) < 2:
            return
        (_, a1, e1, n1), (_, a2, e2, n2) = sorted(distances)[:2]
        sign = 1.0 if a2 >= a1 else -1.0
        heading = atan2(sign * (n2 - n1), sign * (e2 - e1))
        figures.rule_error = max(figures.rule_error, abs(wrap_angle(heading - ego.yaw_rad)))
