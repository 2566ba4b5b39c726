"""Verdicts of a directed radio link on messages: deliver at an instant, or drop.

The verdict on message `seq` depends on the seed, the link and `seq`, and on the instant of sending
if the link changes during the run. It does not depend on the order of arrival, on other links or on
whether `seq - 1` arrived, so it is the same on the wall clock and in virtual time.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import blake2b
from math import cos, radians
from operator import attrgetter
from typing import Final, Literal, NamedTuple, cast

from transport.codec import RefusedMessageError, decode
from transport.links.laws.basic import Latency
from transport.links.laws.link_law import Draw, Effect, StageLaw, TransmissionContext
from transport.topics import REASONS, TOPICS, DropReason
from vehicles.geometry.geodesy import LocalPlane
from vehicles.geometry.sampled_path import TIME_UNIT
from vehicles.messages import GpsPose, Outcome
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import SECOND

_EVER_SINCE, _FOR_EVER = -(2**63), 2**63 - 1  # Before and after any instant (ns) of a run
_STEPS = 2**52  # (k + 1/2) / _STEPS is exact in a double and strictly inside (0, 1)


class Verdict(NamedTuple):
    """Decision of a link; `reason` is empty if delivered, otherwise one of the table.

    `visible_at` (ns) is the instant from which the receiver may read the message, set also for a
    dropped message.
    """

    outcome: Outcome
    reason: DropReason | Literal[""]
    visible_at: int


def keyed_draw(seed: int, sender: str, receiver: str) -> Draw:
    """Draws in (0, 1) for one link, the same on every platform."""
    link = f"{seed}\0{sender}\0{receiver}\0".encode()

    def draw(purpose: str, seq: int) -> float:
        digest = blake2b(link + f"{seq}\0{purpose}".encode(), digest_size=8).digest()
        return ((int.from_bytes(digest, "big") >> 12) + 0.5) / _STEPS

    return draw


def combine(effects: Iterable[Effect], draw: Draw, context: TransmissionContext) -> Verdict:
    """Combine all effects on a message: delays add up, the first drop gives the reason."""
    delay = 0
    reason: DropReason | Literal[""] = ""
    for effect in effects:
        result = effect.judge(draw, context)
        if isinstance(result, str):
            reason = reason or result
        else:
            delay += result
    return Verdict("dropped" if reason else "delivered", reason, context.sent_at + delay)


@dataclass(frozen=True, slots=True)
class ChangedEffects:
    """Effects on messages sent from the instant `from_at` (ns) until the next change.

    `floor` is the minimum latency (ns); the bus has to be faster.
    """

    from_at: int
    effects: tuple[Effect, ...]
    floor: int = field(init=False)

    def __post_init__(self) -> None:
        floors = (effect.floor for effect in self.effects if isinstance(effect, Latency))
        object.__setattr__(self, "floor", sum(floors))


_from_at = attrgetter("from_at")


@dataclass(slots=True)
class Link:
    """A directed link of a run, from one sender to one receiver.

    `effects` judge each message by itself; in `stages` messages affect each other
    (`StagedMessages`). `changes` are in order of time.
    """

    effects: tuple[Effect, ...]
    seed: int
    sender: str
    receiver: str
    stages: tuple[StageLaw, ...] = ()
    changes: Sequence[ChangedEffects] = ()
    draw: Draw = field(init=False, repr=False, compare=False)
    _unchanged: ChangedEffects = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.draw = keyed_draw(self.seed, self.sender, self.receiver)
        self._unchanged = ChangedEffects(_EVER_SINCE, self.effects)

    def effects_at(self, sent_at: int) -> tuple[Effect, ...]:
        """Effects on a message sent at an instant (ns)."""
        if not self.changes:  # the usual case
            return self.effects
        index = bisect_right(self.changes, sent_at, key=_from_at)
        return self.changes[index - 1].effects if index else self.effects

    def judge(self, context: TransmissionContext) -> Verdict:
        return combine(self.effects_at(context.sent_at), self.draw, context)

    def latest_sent_at(self, now: int) -> int:
        """Last instant (ns) at which a message visible by `now` can have been sent.

        If the minimum latency decreases, messages sent shortly before may be overtaken.
        """
        if not self.changes:
            return now - self._unchanged.floor
        periods = [self._unchanged, *self.changes]
        ends = [*(change.from_at for change in self.changes), _FOR_EVER]
        return max(
            min(end - 1, now - period.floor)
            for period, end in zip(periods, ends, strict=True)
            if period.from_at < end and period.from_at + period.floor <= now
        )


# ---- Gate for messages from the bus: refuses messages that cannot be poses of the run
#
# Vehicles decode poses with it, the recorder checks decoded poses. It checks time stamps,
# coordinates and speeds of single messages; whether a pose contradicts earlier ones is checked by
# the follower (`driver.degradation.trust`).


GPS = TOPICS["gps"]
LONGEST_POSE_BYTES: Final = 1024  # With names of 400 letters and the longest path history
MAX_HISTORY_POINTS: Final = 40
MAX_HISTORY_LENGTH: Final = 1500.0
"""Limits of a path history: positions, and length (m, the sum of its parts to the north and to the
east, which is up to 1.42 times the largest length that can be configured)."""
MAX_HISTORY_AGE: Final = 24 * 3600 * 100  # Of its oldest position (10 ms): the longest run
FASTEST: Final = 330.0
NOISE_ALLOWANCE: Final = 6.0
"""Between two of its positions a vehicle covers less than this speed (m/s) times the time between
them, plus this distance (m)."""
METRES_PER_UNIT: Final = 0.0112  # Upper bound (m) of 1e-7 degrees
CACHED_POSES: Final = 64  # In virtual time all receivers of a pose are in one process
HORIZON_NS: Final = 60 * SECOND
"""Poses measured longer ago or further ahead are refused. A process that was suspended resumes in
the past and receives poses measured ahead of its schedule."""

TIMESTAMP_REASONS = ("past", "future")  # If frequent, a clock is wrong
FIRST_REPORT: Final = 100  # The next reports follow at ten times the count
ROUNDING: Final = 0.001  # Tolerance in periods: instants are rounded to nanoseconds
_LIMITS = {
    "latitude_deg": (-90.0, 90.0),
    "longitude_deg": (-180.0, 180.0),
    "altitude_m": (-1e5, 1e5),
    "heading_deg": (0.0, 360.0),
    "speed_mps": (0.0, 150.0),
    "yaw_rate_radps": (-10.0, 10.0),
    "acceleration_mps2": (-1000.0, 1000.0),
    "position_accuracy_m": (0.0, 1e6),
}
_numbers = attrgetter(*_LIMITS)


@lru_cache(maxsize=CACHED_POSES)
def _read(data: bytes) -> tuple[GpsPose, str]:
    """Decoded pose, and a description of its value out of range, if any."""
    pose = cast("GpsPose", decode(GPS, data, exact=True))
    return pose, _absurd(pose)


def _absurd(pose: GpsPose) -> str:
    """Describe a value out of range; empty if all are in range."""
    for (name, (least, most)), value in zip(_LIMITS.items(), _numbers(pose), strict=True):
        if not least <= value <= most:  # refuses NaN, too
            return f"{name} is {value}, allowed {least} to {most}"
    return _absurd_history(pose) if pose.history_age_cs else ""


def _absurd_history(pose: GpsPose) -> str:
    """Describe why no vehicle can have driven a path history; empty if one can."""
    ages = pose.history_age_cs
    if len(ages) > MAX_HISTORY_POINTS:
        return f"history has {len(ages)} positions, allowed {MAX_HISTORY_POINTS}"
    age = sum(ages)
    if min(ages) <= 0 or age > MAX_HISTORY_AGE:
        return "history is not in order of time or too old"
    north = sum(map(abs, pose.history_latitude_e7deg))
    east = sum(map(abs, pose.history_longitude_e7deg))
    length = METRES_PER_UNIT * (north + east * cos(radians(pose.latitude_deg)))
    drivable = FASTEST * age * TIME_UNIT / SECOND + NOISE_ALLOWANCE * len(ages)
    if length > MAX_HISTORY_LENGTH or length > drivable:
        return f"history is {length:.0f} m long"
    return ""


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseGate:
    """Limits of the poses of one sender.

    sender          name of the vehicle
    start_at        first instant of the run (ns)
    rate_hz         maximum rate of the sender
    plane           local plane of the scenario, whose reach limits positions
    oldest_ns       maximum age of a pose; vehicles cannot use older ones, the recorder can
    clock_error_ns  maximum error of the sender's clock, which stamps the measurement
    """

    sender: str
    start_at: int
    rate_hz: float
    plane: LocalPlane
    oldest_ns: int = HORIZON_NS
    clock_error_ns: int = 0

    def admit(self, data: bytes, now: int) -> ReceivedPose:
        """Decode a pose received under the sender's key, at the tick at `now` (ns).

        Raises RefusedMessageError with a reason of the table.
        """
        if len(data) > LONGEST_POSE_BYTES:
            raise RefusedMessageError("oversized", f"more than {LONGEST_POSE_BYTES} bytes")
        message, absurd = _read(data)
        return self._checked(message, absurd, now)

    def check(self, message: GpsPose, now: int) -> ReceivedPose:
        """Check a pose received under the sender's key; raises RefusedMessageError as `admit`."""
        return self._checked(message, _absurd(message), now)

    def _checked(self, message: GpsPose, absurd: str, now: int) -> ReceivedPose:
        if message.vehicle != self.sender:
            raise RefusedMessageError(
                "foreign", f"{message.vehicle!r} under the key of {self.sender}"
            )
        if absurd:
            raise RefusedMessageError("absurd", absurd)
        self._check_schedule(message, now)
        try:
            return receive(message, self.plane, now)
        except ValueError:
            text = f"{message.latitude_deg}, {message.longitude_deg} deg"
            raise RefusedMessageError("far", text) from None

    def _check_schedule(self, pose: GpsPose, now: int) -> None:
        error, measured, sent = self.clock_error_ns, pose.measured_at_ns, pose.sent_at_ns
        if measured < self.start_at - error:
            raise RefusedMessageError("early", f"measured at {measured}")
        if measured < now - self.oldest_ns - error:
            raise RefusedMessageError("past", f"measured at {measured}")
        if measured > now + HORIZON_NS + error:
            raise RefusedMessageError("future", f"measured at {measured}")
        if not (measured - error <= sent and self.start_at <= sent <= now + HORIZON_NS):
            raise RefusedMessageError("future", f"sent at {sent}")
        if pose.seq > (pose.sent_at_ns - self.start_at) * self.rate_hz / SECOND + ROUNDING:
            raise RefusedMessageError("sequence", f"number {pose.seq} is ahead of the schedule")


@dataclass(slots=True)
class TimestampRefusals:
    """Messages that one receiver refused for their time stamps, by sender and reason."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    reported: Counter[tuple[str, str]] = field(default_factory=Counter)

    def count(self, sender: str, reason: str) -> str | None:
        """Count a refused message; returns a warning at 100, 1000, … refusals for time stamps."""
        if reason not in TIMESTAMP_REASONS:
            return None
        key = sender, reason
        self.counts[key] += 1
        if self.counts[key] < (10 * self.reported[key] or FIRST_REPORT):
            return None
        self.reported[key] = count = self.counts[key]
        meaning = REASONS[reason].meaning
        return (
            f"{count} messages of {sender} refused as {reason} ({meaning}). Compare the clocks of "
            "both computers."
        )
