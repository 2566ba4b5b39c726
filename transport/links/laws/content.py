"""Duplicates, reordering, bit errors and false content of messages.

Everything is a function of the link's keyed draws and of the message alone.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, exp, expm1, hypot, inf, log1p, sin
from typing import Annotated, Literal
from zlib import crc32

from pydantic import Field

from transport.codec import RefusedMessageError
from transport.links.laws.link_law import (
    Delays,
    Draw,
    Effect,
    LawTable,
    LinkLaw,
    LinkSetting,
    Losses,
    Problem,
    Ratio,
    TransmissionContext,
)
from transport.topics import DropReason
from vehicles.geometry.geodesy import REACH, LocalPlane, yaw_from_heading
from vehicles.messages import GpsPose
from vehicles.schedule import MILLISECOND, SECOND

# ---- False content: a link replaces the content of messages, or adds messages
#
# It tests whether followers detect it. The content of a message is what its sender measured:
# position, course, motion and reported accuracy. Name, number and instants are unchanged.


LATEST_S = 86_400  # Maximum duration of a run

Seconds = Annotated[float, Field(ge=0, le=LATEST_S)]
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Velocity = Annotated[float, Field(ge=-100, le=100)]

Recall = Callable[[int], GpsPose | None]
"""Returns the sender's newest pose sent by an instant (ns), unaltered.

It includes poses that arrived from the bus and were lost on the emulated link.
"""


@dataclass(frozen=True, slots=True)
class FalseInterval:
    """Interval (ns, end exclusive) in which sent messages have false content."""

    from_at: int = 0
    to_at: float = inf

    def __contains__(self, at: int) -> bool:
        return self.from_at <= at < self.to_at


@dataclass(frozen=True, slots=True)
class Shift:
    """Shift in the plane (m, or m/s), along the world's axes and along the sender's course."""

    east: float = 0.0
    north: float = 0.0
    ahead: float = 0.0
    left: float = 0.0


class FalseContent(LawTable):
    """Base of false contents; the verdicts name them by `kind`.

    from_s  start of the interval of sending, after the start of the run, inclusive
    to_s    end of the interval, exclusive; default: the end of the run

    By default no earlier messages are needed and none are added.
    """

    from_s: Seconds = 0.0
    to_s: Seconds | None = None
    kind: str

    def problems(self) -> Iterator[Problem]:
        if self.to_s is not None and self.to_s <= self.from_s:
            yield "to_s", f"given {self.to_s:g}, allowed more than from_s, {self.from_s:g}"

    @cached_property
    def span(self) -> FalseInterval:
        start_at = self.setting.start_at
        to_at = inf if self.to_s is None else start_at + round(self.to_s * SECOND)
        return FalseInterval(start_at + round(self.from_s * SECOND), to_at)

    @property
    def moments(self) -> tuple[int, ...]:
        """Instants (ns) whose last message is needed."""
        return ()

    @property
    def age(self) -> int:
        """Age (ns) up to which all messages are needed."""
        return 0

    @property
    def after(self) -> int | None:
        """Delay (ns) of the added message after the true one; None if no message is added."""
        return None

    def extra_message(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        """Message added to `pose`; raises RefusedMessageError beyond the plane."""
        raise NotImplementedError

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        """Pose that replaces `pose`, None for no change; raises RefusedMessageError."""
        raise NotImplementedError


class Displaced(FalseContent):
    """Base of contents with a false position."""

    @property
    def by(self) -> Shift:
        """Displacement (m, or m/s)."""
        raise NotImplementedError

    def problems(self) -> Iterator[Problem]:
        yield from super().problems()
        if self.by == Shift():
            units = ("_m", "_mps")
            keys = ", ".join(key for key in type(self).model_fields if key.endswith(units))
            yield "", f"displaces nothing, allowed a value other than 0 in {keys}"


class FalseOffset(Displaced):
    """Constant displacement of the position.

    east_m   displacement to the east
    north_m  displacement to the north
    ahead_m  displacement forward, along the sender's course
    left_m   displacement to the left of the sender's course
    """

    kind: Literal["offset"] = "offset"
    east_m: Metres = 0.0
    north_m: Metres = 0.0
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(self.east_m, self.north_m, self.ahead_m, self.left_m)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:
        return displace(pose, plane, self.by)


class FalseDrift(Displaced):
    """Displacement that grows from `from_s`.

    east_mps   rate to the east
    north_mps  rate to the north
    ahead_mps  rate forward, along the sender's course
    left_mps   rate to the left of the sender's course
    """

    kind: Literal["drift"] = "drift"
    east_mps: Velocity = 0.0
    north_mps: Velocity = 0.0
    ahead_mps: Velocity = 0.0
    left_mps: Velocity = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(self.east_mps, self.north_mps, self.ahead_mps, self.left_mps)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose:
        return displace(pose, plane, self.by, (pose.sent_at_ns - self.span.from_at) / SECOND)


class FrozenContent(FalseContent):
    """Repeats the last content before `from_s`, with new numbers and time stamps."""

    kind: Literal["frozen"] = "frozen"
    from_s: Annotated[float, Field(gt=0, le=LATEST_S)]

    @property
    def moments(self) -> tuple[int, ...]:
        return (self.span.from_at - 1,)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return replace_content(pose, recall(self.span.from_at - 1))


class ReplayedContent(FalseContent):
    """Repeats old content, with new numbers and time stamps.

    age_s  minimum age of the content
    """

    kind: Literal["replayed"] = "replayed"
    age_s: Annotated[float, Field(gt=0, le=60)]

    @cached_property
    def age(self) -> int:
        return round(self.age_s * SECOND)

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return replace_content(pose, recall(pose.sent_at_ns - self.age))


class GhostVehicle(Displaced):
    """After each message, adds a forged message in the sender's name that reports a ghost vehicle.

    ahead_m  position of the ghost ahead of the sender, along its course
    left_m   position of the ghost to the left of the sender's course

    The forged message is stamped and arrives half a period of the sender's maximum rate after the
    true one, so that both alternate. It has the number of the true message and bypasses the
    receiver's check of numbers.
    """

    kind: Literal["ghost"] = "ghost"
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0

    @cached_property
    def by(self) -> Shift:
        return Shift(ahead=self.ahead_m, left=self.left_m)

    @cached_property
    def after(self) -> int:
        return round(SECOND / (2.0 * self.setting.source_rate_hz))

    def falsify(self, pose: GpsPose, plane: LocalPlane, recall: Recall) -> GpsPose | None:
        return pose

    def extra_message(self, pose: GpsPose, plane: LocalPlane) -> GpsPose:
        travelled = pose.speed_mps * self.after / SECOND
        ghost = displace(pose, plane, replace(self.by, ahead=self.ahead_m + travelled))
        return shift_times(ghost, self.after)


def displace(pose: GpsPose, plane: LocalPlane, by: Shift, times: float = 1.0) -> GpsPose:
    """Move `pose` by `times` the shift; raises RefusedMessageError beyond the plane."""
    east, north = plane.to_plane(pose.latitude_deg, pose.longitude_deg, pose.altitude_m)
    yaw = yaw_from_heading(pose.heading_deg)
    east += times * (by.east + by.ahead * cos(yaw) - by.left * sin(yaw))
    north += times * (by.north + by.ahead * sin(yaw) + by.left * cos(yaw))
    if not hypot(east, north) < REACH:
        raise RefusedMessageError("far", f"{east:.0f} m east, {north:.0f} m north")
    latitude_deg, longitude_deg, altitude_m = plane.to_geodetic(east, north)
    return replace(
        pose, latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_m=altitude_m
    )


def shift_times(pose: GpsPose, by: int) -> GpsPose:
    measured_at_ns, sent_at_ns = pose.measured_at_ns + by, pose.sent_at_ns + by
    return replace(pose, measured_at_ns=measured_at_ns, sent_at_ns=sent_at_ns)


def replace_content(pose: GpsPose, old: GpsPose | None) -> GpsPose | None:
    """Content of `old` with the number and the instants of `pose`; None without `old`."""
    if old is None:
        return None
    return replace(
        old, seq=pose.seq, measured_at_ns=pose.measured_at_ns, sent_at_ns=pose.sent_at_ns
    )


# ---- Content


# fmt: off
FalseLaw = Annotated[
    FalseOffset
    | FalseDrift
    | FrozenContent
    | ReplayedContent
    | GhostVehicle,
    Field(discriminator="kind"),
]
# fmt: on


class ContentLaw(LinkLaw):
    """Alterations of the content and the number of messages.

    duplicate_ratio     share of delivered messages that are duplicated
    duplicate_delay_ms  delay of the duplicate after the message; by default drawn like that of the
                        message, but never before it
    filter_duplicates   whether the receiver rejects duplicates by their number, as radio stacks do
    reorder_ratio       share of messages held back, so that later ones overtake them
    reorder_delay_ms    how long they are held back
    bit_error_ratio     probability that a bit of a frame is flipped
    frame_check         whether the receiver rejects altered frames by their checksum (CRC-32)
    false               list of false contents, applied in order
    """

    key = "content"
    reason = "corrupted"

    duplicate_ratio: Ratio = 0.0
    duplicate_delay_ms: Annotated[float, Field(ge=0, le=60_000)] | None = None
    filter_duplicates: bool = True
    reorder_ratio: Ratio = 0.0
    reorder_delay_ms: Annotated[float, Field(gt=0, le=60_000)] = 100.0
    bit_error_ratio: Annotated[float, Field(ge=0, le=0.1)] = 0.0
    frame_check: bool = True
    false: Annotated[tuple[FalseLaw, ...], Field(strict=False)] = ()

    def problems(self) -> Iterator[Problem]:
        for index, law in enumerate(self.false):
            for key, why in law.problems():
                yield f"false[{index}].{key}".removesuffix("."), why

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        if not self.reorder_ratio:
            return ()
        return (Reordering(self.reorder_ratio, round(self.reorder_delay_ms * MILLISECOND)),)

    @property
    def alters_messages(self) -> bool:
        return bool(self.duplicate_ratio or self.bit_error_ratio or self.false)

    @property
    def duplication(self) -> "Duplication | None":
        late_ms = self.duplicate_delay_ms
        delay = None if late_ms is None else round(late_ms * MILLISECOND)
        return Duplication(self.duplicate_ratio, delay) if self.duplicate_ratio else None

    @property
    def bit_errors(self) -> "BitErrors | None":
        if not self.bit_error_ratio:
            return None
        return BitErrors(self.bit_error_ratio, self.frame_check)

    def corrupted(self, size: int) -> Losses | None:
        """Loss of frames of `size` bytes by bit errors; None without a frame check."""
        errors = self.bit_errors
        if errors is None:
            return Losses(0.0)
        return Losses.independent(errors.corrupted_share(size)) if self.frame_check else None


@dataclass(frozen=True, slots=True)
class Reordering(Effect):
    """Holds each message back for `delay` ns, independently with probability `ratio`."""

    ratio: float
    delay: int

    key = "content"

    @property
    def delays(self) -> Delays:
        variance = self.ratio * (1.0 - self.ratio) * self.delay**2
        return Delays(self.ratio * self.delay, variance)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return self.delay if draw("reorder", context.seq) < self.ratio else 0


@dataclass(frozen=True, slots=True)
class Duplication:
    """Copies each delivered message, independently with probability `ratio`.

    The copy arrives `delay` ns after the message. With None its delay is drawn like that of the
    message, but it never arrives before the message.
    """

    ratio: float
    delay: int | None = None

    def copies(self, draw: Draw, seq: int) -> int:
        return int(draw("duplicate", seq) < self.ratio)


def copy_draw(draw: Draw) -> Draw:
    """Draws for the copy of a message, independent of those for the message."""
    return lambda purpose, seq: draw(f"copy {purpose}", seq)


@dataclass(frozen=True, slots=True)
class BitErrors:
    """Flips each bit of a frame, independently with probability `ratio`.

    With `frame_check` the receiver compares the frame's CRC-32 with that of the frame as sent.
    """

    ratio: float
    frame_check: bool = True

    def corrupted_share(self, size: int) -> float:
        """Probability that a frame of `size` bytes has errors: 1 - (1 - ratio)^(8 size)."""
        return -expm1(8 * size * log1p(-self.ratio))

    def flips(self, draw: Draw, seq: int, size: int) -> int:
        """Number of flipped bits in a frame of `size` bytes: binomial, by inversion.

        With a higher ratio the same frames have errors, and more.
        """
        bits, drawn = 8 * size, draw("bits", seq)
        if drawn >= self.corrupted_share(size):
            return 0
        share = reached = exp(bits * log1p(-self.ratio))
        count = 0
        while reached < 1.0 - drawn and count < bits:
            share *= (bits - count) / (count + 1) * self.ratio / (1.0 - self.ratio)
            reached += share
            count += 1
        return count

    def is_detected(self, sent: bytes, came: bytes) -> bool:
        """Whether the receiver's frame check refuses `came`, which was sent as `sent`."""
        return self.frame_check and crc32(came) != crc32(sent)


def choose_bits(draw: Draw, seq: int, count: int, bits: int) -> list[int]:
    """Indices of `count` different bits out of `bits`, all equally likely.

    The first steps of a Fisher–Yates shuffle; only moved entries are stored.
    """
    moved: dict[int, int] = {}
    places = []
    for k in range(min(count, bits)):
        other = k + int(draw(f"bit {k}", seq) * (bits - k))
        places.append(moved.get(other, other))
        moved[other] = moved.get(k, k)
    return places


def flip_bits(frame: bytes, places: Iterable[int]) -> bytes:
    changed = bytearray(frame)
    for place in places:
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)
