"""How far each vehicle drives beside the path the lead drove, as the true poses come in."""

import math
from dataclasses import dataclass, field

from vehicles.messages import TruePose

RUN_IN_M = 1000.0
"""Followers start behind the lead: its path is taken to begin with a straight of this length."""
LEAST_STEP_M = 0.05
"""Poses of the lead closer together than this make no new piece of its path."""


@dataclass(slots=True)
class BesideLead:
    """The lead's driven path as it grows, and where beside it each follower was last.

    Every follower's foot point is searched onwards from its last one, so another leg or lap of
    the path never attracts it.
    """

    points: list[tuple[float, float]] = field(default_factory=list)
    reached: dict[str, int] = field(default_factory=dict)

    def lead_at(self, pose: TruePose) -> None:
        """Take in the next pose of the lead."""
        if not self.points:
            self.points.append(
                (
                    pose.east_m - RUN_IN_M * math.cos(pose.yaw_rad),
                    pose.north_m - RUN_IN_M * math.sin(pose.yaw_rad),
                )
            )
        east, north = self.points[-1]
        if math.hypot(pose.east_m - east, pose.north_m - north) > LEAST_STEP_M:
            self.points.append((pose.east_m, pose.north_m))

    def offset(self, pose: TruePose) -> float | None:
        """Distance of a follower to the lead's path (m, left positive); None where it ends."""
        index = max(self.reached.get(pose.vehicle, 0) - 1, 0)
        while index + 1 < len(self.points):
            (east, north), (next_east, next_north) = self.points[index : index + 2]
            along_east, along_north = next_east - east, next_north - north
            to_east, to_north = pose.east_m - east, pose.north_m - north
            square = along_east**2 + along_north**2
            if to_east * along_east + to_north * along_north <= square:
                self.reached[pose.vehicle] = index
                return (along_east * to_north - along_north * to_east) / math.sqrt(square)
            index += 1
        return None
