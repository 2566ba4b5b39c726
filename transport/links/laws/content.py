"""What a link does to the bytes and the number of messages: copies, held-back ones, wrong bits.

Everything here is a function of the link's keyed draws and of the message alone.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import exp, expm1, log1p
from zlib import crc32

from transport.links.laws.effect import Draw, Effect, Passage
from transport.links.laws.moments import Delays
from transport.reasons import DropReason
from vehicles.schedule import MILLISECOND


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
        """Moments of the delay, of those held back or not."""
        variance = self.ratio * (1.0 - self.ratio) * self.delay**2
        return Delays(self.ratio * self.delay, variance)

    def describe(self) -> str:
        """Give share and delay."""
        return f"{100.0 * self.ratio:g} % held back for {self.delay / MILLISECOND:g} ms"

    def judge(self, draw: Draw, passage: Passage) -> int | DropReason:
        """Delay when the message's draw falls below the ratio."""
        return self.delay if draw("reorder", passage.seq) < self.ratio else 0


@dataclass(frozen=True, slots=True)
class Duplication:
    """Makes a copy of each delivered message, on its own with probability `ratio`.

    The copy comes `delay` ns after the message; with None, after a delay of its own that is drawn
    as the message's was, but never before the message.
    """

    ratio: float
    delay: int | None = None

    def copies(self, draw: Draw, seq: int) -> int:
        """How many copies are made of a message: one or none."""
        return int(draw("duplicate", seq) < self.ratio)


def draw_of_copy(draw: Draw) -> Draw:
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

    def is_noticed(self, sent: bytes, came: bytes) -> bool:
        """Whether the receiver's frame check refuses `came`, which was `sent`."""
        return self.frame_check and crc32(came) != crc32(sent)


def flip_places(draw: Draw, seq: int, count: int, bits: int) -> list[int]:
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


def flipped(frame: bytes, places: Iterable[int]) -> bytes:
    """Return `frame` with the bits at `places` the other way round."""
    changed = bytearray(frame)
    for place in places:
        changed[place // 8] ^= 1 << place % 8
    return bytes(changed)
