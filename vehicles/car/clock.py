"""A vehicle's own clock, with an initial offset and a drift."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vehicles.received_pose import ReceivedPose

MILLION: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class VehicleClock:
    """A clock that reads true time + offset + drift · t (the paper's vehicles share one time).

    `offset` (ns) applies at the start of the run, `start_at` (ns); `drift` is in parts per million.
    Drift over a control period is negligible, so a vehicle keeps the true schedule.
    """

    start_at: int = 0
    offset: int = 0
    drift: float = 0.0

    def error(self, now: int) -> int:
        """Error (ns, positive if the clock is ahead) at the true instant `now` (ns)."""
        return self.offset + round(self.drift * (now - self.start_at) / MILLION)

    def reading(self, at: int) -> int:
        return at + self.error(at)  # ns

    def restamped(self, now: int, poses: Sequence[ReceivedPose]) -> Sequence[ReceivedPose]:
        """Subtract the clock's error at `now` (ns) from the time stamps of received poses.

        The age of such a pose in true time equals its age by this clock.
        """
        if not (self.offset or self.drift):
            return poses
        error = self.error(now)
        return [replace(pose, measured_at=pose.measured_at - error) for pose in poses]
