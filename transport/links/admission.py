"""Which received poses can be true: everything else is refused before it can do harm."""

from dataclasses import dataclass
from operator import attrgetter
from typing import cast

from transport.clock import NS_PER_S
from transport.codec import RefusedMessageError, decode
from transport.topics import TOPICS
from vehicles.messages import GpsPose

GPS = TOPICS["gps"]
LONGEST_POSE_BYTES = 512
"""A pose with a name of 400 letters still fits."""
HORIZON_NS = 60 * NS_PER_S
"""Poses measured longer ago, or further ahead, than this are refused. Ahead there must be room:
a vehicle that was held up hears, when it goes on, what the others sent meanwhile."""

_ROUNDING = 0.001
"""Periods; instants are rounded to nanoseconds."""
_LARGEST = {
    "latitude_deg": 90.0,
    "longitude_deg": 360.0,
    "altitude_m": 1e5,
    "heading_deg": 360.0,
    "speed_mps": 200.0,
    "yaw_rate_radps": 100.0,
}
_numbers = attrgetter(*_LARGEST)


@dataclass(frozen=True, slots=True)
class Admission:
    """What is known beforehand of a sender's poses: whose they are, since when and how often.

    `start_at` (ns) is the run's first instant, `rate_hz` the sender's GNSS rate.
    """

    sender: str
    start_at: int
    rate_hz: float

    def admit(self, data: bytes, now: int) -> GpsPose:
        """Read a pose that came under the sender's key, at a tick of instant `now` (ns).

        Raises RefusedMessageError with a one-word reason.
        """
        if len(data) > LONGEST_POSE_BYTES:
            raise RefusedMessageError("oversized", f"more than {LONGEST_POSE_BYTES} bytes")
        pose = cast("GpsPose", decode(GPS, data, exact=True))
        if pose.vehicle != self.sender:
            raise RefusedMessageError("foreign", f"{pose.vehicle!r} in the name of {self.sender}")
        for (name, largest), value in zip(_LARGEST.items(), _numbers(pose), strict=True):
            if not -largest <= value <= largest:  # so that NaN is refused too
                raise RefusedMessageError("absurd", f"{name} is {value}, at most {largest}")
        self._check_schedule(pose, now)
        return pose

    def _check_schedule(self, pose: GpsPose, now: int) -> None:
        elapsed = pose.measured_at_ns - self.start_at
        if elapsed < 0 or pose.measured_at_ns < now - HORIZON_NS:
            raise RefusedMessageError("past", f"measured at {pose.measured_at_ns}")
        if pose.measured_at_ns > now + HORIZON_NS:
            raise RefusedMessageError("future", f"measured at {pose.measured_at_ns}")
        if pose.seq > elapsed * self.rate_hz / NS_PER_S + _ROUNDING:
            raise RefusedMessageError("sequence", f"number {pose.seq} is ahead of the schedule")
