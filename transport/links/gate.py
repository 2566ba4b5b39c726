"""The wire gate: which messages can be poses of a run at all. Everything else is refused.

One gate for all receivers. Vehicles read poses off the wire through it, the recorder checks with it
what it has decoded for the log. It judges stamps, coordinates and speeds of a message by itself;
whether a pose contradicts earlier ones is judged by the follower (`driver.degradation.trust`).
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
"""A pose with a name of 400 letters still fits."""
READ_LAST: Final = 64
"""Poses that are not read again: in virtual time all receivers of one are in one process."""
HORIZON_NS: Final = 60 * SECOND
"""Poses measured longer ago, or further ahead, than this are refused. Ahead there must be room:
a vehicle whose process was suspended receives, when it resumes, what was sent meanwhile."""

MISDATED = ("past", "future")
"""Reasons that blame the clock of the sender or of the receiver, when there are many."""
MANY: Final = 100
"""Number that is reported first; then ten times as many, and so on."""

_ROUNDING: Final = 0.001
"""Periods; instants are rounded to nanoseconds."""
_LIMITS = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    "altitude_m": (-1e5, 1e5),
    "heading_deg": (0.0, 360.0),
    "speed_mps": (0.0, 150.0),
    "yaw_rate_radps": (-10.0, 10.0),
}
"""No vehicle of a convoy measures less or more."""
_numbers = attrgetter(*_LIMITS)


@lru_cache(maxsize=READ_LAST)
def _read(data: bytes) -> tuple[GpsPose, str]:
    """Message of these bytes, and which of its numbers no vehicle measures, if there is one."""
    pose = cast("GpsPose", decode(GPS, data, exact=True))
    return pose, _absurd(pose)


def _absurd(pose: GpsPose) -> str:
    """Name the number that no vehicle measures; empty if all can be."""
    for (name, (least, most)), value in zip(_LIMITS.items(), _numbers(pose), strict=True):
        if not least <= value <= most:  # so that NaN is refused too
            return f"{name} is {value}, from {least} to {most}"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseGate:
    """The limits of one sender's poses: its name, its start, its rate, the reach of its plane.

    `start_at` (ns) is the run's first instant, `rate_hz` the rate at which the sender sends at
    most, `plane` the scenario's, within reach of which the convoy drives. `oldest_ns` is how long
    ago a pose may have been measured: a vehicle cannot use what is a minute old, a recorder can.
    By `clock_error_ns` the sender's own clock may be off, by which it says when it measured.
    """

    sender: str
    start_at: int
    rate_hz: float
    plane: LocalPlane
    oldest_ns: int = HORIZON_NS
    clock_error_ns: int = 0

    def admit(self, data: bytes, now: int) -> ReceivedPose:
        """Read a pose that came under the sender's key, at a tick of instant `now` (ns).

        Raises RefusedMessageError with a word of the table of reasons.
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
class MisdatedCount:
    """Messages that one receiver refused for their stamps, by sender and reason."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    reported: Counter[tuple[str, str]] = field(default_factory=Counter)

    def count(self, sender: str, reason: str) -> str | None:
        """Count a refused message; returns a line whenever these are many, or again ten times so.

        Other reasons than those of stamps are passed over.
        """
        if reason not in MISDATED:
            return None
        key = sender, reason
        self.counts[key] += 1
        if self.counts[key] < (10 * self.reported[key] or MANY):
            return None
        self.reported[key] = count = self.counts[key]
        meaning = REASONS[reason].meaning
        return f"{count} messages of {sender} refused as {reason}, {meaning}: do the clocks agree?"
