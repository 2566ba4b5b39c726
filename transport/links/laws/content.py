"""Duplicates, reordering, bit errors and false content of messages.

Everything is a function of the link's keyed draws and of the message alone.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import exp, expm1, log1p
from typing import Annotated
from zlib import crc32

from pydantic import Field

from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.false_content import (
    FalseDrift,
    FalseOffset,
    FrozenContent,
    GhostVehicle,
    ReplayedContent,
)
from transport.links.laws.link_law import LinkLaw, LinkSetting, Problem, Ratio
from transport.links.laws.moments import Delays, Losses
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND

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
            return Losses(0.0, None, 0.0)
        return Losses.independent(errors.corrupted_share(size)) if self.frame_check else None

    def describe_content(self) -> Iterator[str]:
        if self.duplicate_ratio:
            late = self.duplicate_delay_ms
            after = "with a delay of its own" if late is None else f"{late:g} ms later"
            accepted = "refused by number" if self.filter_duplicates else "accepted"
            yield f"{100.0 * self.duplicate_ratio:g} % duplicated, copy {after}, {accepted}"
        if self.bit_error_ratio:
            checked = "altered frames refused" if self.frame_check else "frames not checked"
            yield f"bit error ratio {self.bit_error_ratio:g}, {checked}"
        for law in self.false:
            yield law.describe()


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

    def describe(self) -> str:
        return f"{100.0 * self.ratio:g} % held back for {self.delay / MILLISECOND:g} ms"

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
