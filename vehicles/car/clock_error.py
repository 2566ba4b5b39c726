"""A vehicle's own clock, with an offset at the start and a drift."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vehicles.received_pose import ReceivedPose

MILLION: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class VehicleClock:
    """Reads true + offset + drift · t (not in the paper, whose vehicles share one time).

    `offset` (ns) holds at the start of the run, `start_at` (ns); `drift` is in millionths. Over a
    control period the drift is negligible, so the schedule of a vehicle is the true one.
    """

    start_at: int = 0
    offset: int = 0
    drift: float = 0.0

    def error(self, now: int) -> int:
        """Error (ns, ahead positive) at the true instant `now` (ns)."""
        if not self.drift:
            return self.offset
        return self.offset + round(self.drift * (now - self.start_at) / MILLION)

    def reading(self, at: int) -> int:
        """Reading (ns) at the true instant `at` (ns)."""
        return at + self.error(at)

    def restamped(self, now: int, poses: Sequence[ReceivedPose]) -> Sequence[ReceivedPose]:
        """Poses received at `now` (ns) with their stamps made earlier by the clock's error.

        That has the effect of comparing their stamps with readings of this clock.
        """
        error = self.error(now)
        if not error:
            return poses
        return [replace(pose, measured_at=pose.measured_at - error) for pose in poses]
