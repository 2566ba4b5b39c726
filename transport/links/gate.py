"""The wire gate: refuses messages that cannot be poses of a run.

Vehicles read poses off the wire through it, the recorder checks decoded poses with it. It judges
stamps, coordinates and speeds of a message by itself; whether a pose contradicts earlier ones is
judged by the follower (`driver.degradation.trust`).
"""

from collections import Counter
from dataclasses import dataclass, field
from functools import lru_cache
from operator import attrgetter
from typing import Final, cast

from transport.codec import RefusedMessageError, decode
from transport.reasons import REASONS
from transport.topics import TOPICS
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import SECOND

GPS = TOPICS["gps"]
LONGEST_POSE_BYTES: Final = 512
"""Enough for a pose with a name of 400 letters."""
CACHED_POSES: Final = 64
"""Number of cached poses: in virtual time all receivers of a pose are in one process."""
HORIZON_NS: Final = 60 * SECOND
"""Poses measured longer ago, or further ahead, than this are refused. Ahead there must be room:
a vehicle whose process was suspended receives, when it resumes, what was sent meanwhile."""

TIMESTAMP_REASONS = ("past", "future")
"""Reasons that, when frequent, point to the clock of the sender or of the receiver."""
FIRST_REPORT: Final = 100
"""Number that is reported first; then ten times that, and so on."""

_ROUNDING: Final = 0.001
"""Tolerance in periods: instants are rounded to nanoseconds."""
_LIMITS = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    "altitude_m": (-1e5, 1e5),
    "heading_deg": (0.0, 360.0),
    "speed_mps": (0.0, 150.0),
    "yaw_rate_radps": (-10.0, 10.0),
}
"""Range of each number that a vehicle of a convoy can measure."""
_numbers = attrgetter(*_LIMITS)


@lru_cache(maxsize=CACHED_POSES)
def _read(data: bytes) -> tuple[GpsPose, str]:
    """Message of these bytes, and its number out of range, if there is one."""
    pose = cast("GpsPose", decode(GPS, data, exact=True))
    return pose, _absurd(pose)


def _absurd(pose: GpsPose) -> str:
    """Name a number that no vehicle measures; empty if all are in range."""
    for (name, (least, most)), value in zip(_LIMITS.items(), _numbers(pose), strict=True):
        if not least <= value <= most:  # so that NaN is refused too
            return f"{name} is {value}, from {least} to {most}"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseGate:
    """The limits of one sender's poses: its name, its start, its rate, the reach of its plane.

    `start_at` (ns) is the run's first instant, `rate_hz` the sender's highest rate, `plane` the
    scenario's. A pose may be up to `oldest_ns` old: a vehicle cannot use an older one, a recorder
    can. `clock_error_ns` is the largest error of the sender's clock, which stamps the measurement.
    """

    sender: str
    start_at: int
    rate_hz: float
    plane: LocalPlane
    oldest_ns: int = HORIZON_NS
    clock_error_ns: int = 0

    def admit(self, data: bytes, now: int) -> ReceivedPose:
        """Read a pose that came under the sender's key, at a tick of instant `now` (ns).

        Raises RefusedMessageError with a reason of the table.
        """
        if len(data) > LONGEST_POSE_BYTES:
            raise RefusedMessageError("oversized", f"more than {LONGEST_POSE_BYTES} bytes")
        message, absurd = _read(data)
        return self._checked(message, absurd, now)

    def check(self, message: GpsPose, now: int) -> ReceivedPose:
        """Check a pose that came under the sender's key; raises RefusedMessageError as `admit`."""
        return self._checked(message, _absurd(message), now)

    def _checked(self, message: GpsPose, absurd: str, now: int) -> ReceivedPose:
        if message.vehicle != self.sender:
            text = f"{message.vehicle!r} in the name of {self.sender}"
            raise RefusedMessageError("foreign", text)
        if absurd:
            raise RefusedMessageError("absurd", absurd)
        self._check_schedule(message, now)
        try:
            return receive(message, self.plane, now)
        except ValueError:
            text = f"{message.latitude_deg}, {message.longitude_deg} deg"
            raise RefusedMessageError("far", text) from None

    def _check_schedule(self, pose: GpsPose, now: int) -> None:
        off, measured, sent = self.clock_error_ns, pose.measured_at_ns, pose.sent_at_ns
        if measured < self.start_at - off:
            raise RefusedMessageError("early", f"measured at {measured}")
        if measured < now - self.oldest_ns - off:
            raise RefusedMessageError("past", f"measured at {measured}")
        if measured > now + HORIZON_NS + off:
            raise RefusedMessageError("future", f"measured at {measured}")
        if not (measured - off <= sent and self.start_at <= sent <= now + HORIZON_NS):
            raise RefusedMessageError("future", f"sent at {sent}")
        if pose.seq > (pose.sent_at_ns - self.start_at) * self.rate_hz / SECOND + _ROUNDING:
            raise RefusedMessageError("sequence", f"number {pose.seq} is ahead of the schedule")


@dataclass(slots=True)
class TimestampRefusals:
    """Messages that one receiver refused for their stamps, by sender and reason."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    reported: Counter[tuple[str, str]] = field(default_factory=Counter)

    def count(self, sender: str, reason: str) -> str | None:
        """Count a message refused for its stamps; returns a line at 100, 1000, and so on."""
        if reason not in TIMESTAMP_REASONS:
            return None
        key = sender, reason
        self.counts[key] += 1
        if self.counts[key] < (10 * self.reported[key] or FIRST_REPORT):
            return None
        self.reported[key] = count = self.counts[key]
        meaning = REASONS[reason].meaning
        return f"{count} messages of {sender} refused as {reason}, {meaning}: do the clocks agree?"
