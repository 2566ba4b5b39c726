"""What a link does to the bytes and the number of messages: copies, held-back ones, wrong bits.

Everything here is a function of the link's keyed draws and of the message alone.
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
    """What a link does to the content and the number of messages.

    duplicate_ratio     share of delivered messages that come twice
    duplicate_delay_ms  how much later the copy comes; left out, after a delay of its own, drawn as
                        the message's was, but never before the message
    filter_duplicates   whether the receiver refuses copies by their number, as radio stacks do
    reorder_ratio       share of messages held back, so that later ones overtake them
    reorder_delay_ms    for how long
    bit_error_ratio     probability that a bit of a frame is flipped
    frame_check         whether the receiver refuses such frames by their checksum
    false               kinds of false content, one on top of the other
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
        for place, law in enumerate(self.false):
            for key, why in law.problems():
                yield f"false[{place}].{key}".removesuffix("."), why

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
        """Loss by wrong bits of frames of `size` bytes: known where every one is refused."""
        errors = self.bit_errors
        if errors is None:
            return Losses(0.0, None, 0.0)
        return Losses.independent(errors.corrupted_share(size)) if self.frame_check else None

    def describe_content(self) -> Iterator[str]:
        if self.duplicate_ratio:
            late = self.duplicate_delay_ms
            after = "after a delay of its own" if late is None else f"{late:g} ms later"
            taken = "refused by its number" if self.filter_duplicates else "taken"
            yield f"{100.0 * self.duplicate_ratio:g} % come twice, the copy {after}, {taken}"
        if self.bit_error_ratio:
            checks = "refuses" if self.frame_check else "does not check"
            yield f"each bit wrong with {self.bit_error_ratio:g}, the receiver {checks} such frames"
        for law in self.false:
            yield law.describe()


@dataclass(frozen=True, slots=True)
class Reordering(Effect):
    """Holds each message back, on its own with probability `ratio`, for `delay` ns.

    It is overtaken by those that are sent meanwhile, unless they are held back too.
    """

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
    """Makes a copy of each delivered message, on its own with probability `ratio`.

    The copy comes `delay` ns after the message; with None, after a delay of its own that is drawn
    as the message's was, but never before the message.
    """

    ratio: float
    delay: int | None = None

    def copies(self, draw: Draw, seq: int) -> int:
        return int(draw("duplicate", seq) < self.ratio)


def copy_draw(draw: Draw) -> Draw:
    """Return the draws of a message's copy, apart from the message's own."""
    return lambda purpose, seq: draw(f"copy {purpose}", seq)


@dataclass(frozen=True, slots=True)
class BitErrors:
    """Flips each bit of a frame, on its own with probability `ratio`.

    With `frame_check` the receiver compares the frame's CRC-32 with that of the frame as sent.
    """

    ratio: float
    frame_check: bool = True

    def corrupted_share(self, size: int) -> float:
        """Probability that a frame of `size` bytes is hit: 1 - (1 - ratio)^(8 size)."""
        return -expm1(8 * size * log1p(-self.ratio))

    def flips(self, draw: Draw, seq: int, size: int) -> int:
        """How many bits of a frame of `size` bytes are flipped: binomial, by inversion.

        With a higher ratio the same frames are hit, and more.
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
        """Whether the receiver's frame check refuses `came`, which was `sent`."""
        return self.frame_check and crc32(came) != crc32(sent)


def choose_bits(draw: Draw, seq: int, count: int, bits: int) -> list[int]:
    """Which `count` different ones of a frame's `bits` are flipped, all equally likely.

    The first steps of a Fisher-Yates shuffle, of which only what was moved is written down.
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
