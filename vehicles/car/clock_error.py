"""A vehicle's own clock, which is off: by how much at the start, and by how much more since."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vehicles.received_pose import ReceivedPose

MILLION: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class VehicleClock:
    """Reads true + offset + drift · t (not in the paper, whose vehicles share one time).

    `offset` (ns) at the start of the run, `start_at` (ns), and `drift` in millionths since. Over a
    control period no drift is felt, so the schedule of a vehicle is the true one.
    """

    start_at: int = 0
    offset: int = 0
    drift: float = 0.0

    def error(self, now: int) -> int:
        """By how much (ns) it is ahead at the true instant `now` (ns)."""
        if not self.drift:
            return self.offset
        return self.offset + round(self.drift * (now - self.start_at) / MILLION)

    def stamped(self, at: int) -> int:
        """Return what it reads (ns) at the true instant `at` (ns)."""
        return at + self.error(at)

    def judged(self, now: int, poses: Sequence[ReceivedPose]) -> Sequence[ReceivedPose]:
        """Poses received at `now` (ns) with their stamps as old as they seem by this clock.

        A stamp compared with a reading of this clock is wrong by the clock's error, as if the clock
        were right and the stamp earlier by that.
        """
        error = self.error(now)
        if not error:
            return poses
        return [replace(pose, measured_at=pose.measured_at - error) for pose in poses]
