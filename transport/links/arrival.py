"""What comes out of a link whose channel alters or copies messages, once they are visible.

A link's verdict is worked out when a message comes off the bus, what is said here when it becomes
visible: by then all that was sent earlier has come as well, in whatever order. So what false
content repeats is the same on every clock, as long as the wire stays below the link's least delay.
"""

from bisect import bisect_right, insort
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Final, NamedTuple, cast

from transport.codec import RefusedMessageError, decode, encode
from transport.links.gate import GPS, HORIZON_NS, PoseGate
from transport.links.laws.content import BitErrors, Duplication, draw_of_copy, flip_places, flipped
from transport.links.laws.effect import Passage
from transport.links.laws.false_content import (
    FalseContent,
    FrozenContent,
    GhostVehicle,
    ReplayedContent,
    put_off,
)
from transport.links.link import Link, Verdict, combine
from vehicles.messages import GpsPose

COPY: Final = 1
GHOST: Final = 2
"""What comes of a message besides itself: its copy, and from this number on its ghosts."""
FRAMES_SINCE: Final = 2**60
"""Instant (ns, the year 2006) of the run's start in frames whose bits are flipped: so that what a
flipped bit makes of an instant does not depend on the day, nor does the length of the frame."""
_sent_at = attrgetter("sent_at_ns")


class Further(NamedTuple):
    """A further pose that comes of a message, from instant `at` (ns) on; `nth` is COPY or GHOST."""

    at: int
    nth: int
    pose: GpsPose


class Arrival(NamedTuple):
    """What a receiver makes of a message: the verdict, the pose it is told, and what is false.

    `further` comes later, of which `copies` are copies of the message.
    """

    verdict: Verdict
    pose: GpsPose
    content: str
    copies: int
    further: list[Further]


class Memory:
    """A sender's poses as they came off the bus, by when they were sent, as far back as is needed.

    Needed are the last ones until certain `moments` (ns), and all for `span` ns. What is visible
    may have been sent up to two minutes before the newest.
    """

    def __init__(self, moments: Iterable[int] = (), span: int = 0) -> None:
        self._last: dict[int, GpsPose | None] = dict.fromkeys(moments)
        self._span = span
        self._poses: list[GpsPose] = []

    def note(self, pose: GpsPose) -> None:
        """Remember a pose that came."""
        for moment, last in self._last.items():
            if pose.sent_at_ns <= moment and (last is None or last.sent_at_ns < pose.sent_at_ns):
                self._last[moment] = pose
        if self._span:
            insort(self._poses, pose, key=_sent_at)
            oldest = self._poses[-1].sent_at_ns - self._span - 2 * HORIZON_NS
            while self._poses[0].sent_at_ns < oldest:
                del self._poses[0]

    def newest(self, until: int) -> GpsPose | None:
        """Return the newest pose that was sent by the instant `until` (ns), None without any."""
        if until in self._last:
            return self._last[until]
        place = bisect_right(self._poses, until, key=_sent_at)
        return self._poses[place - 1] if place else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentStage:
    """What becomes of the messages of a link behind its verdict: copies, wrong bits, false content.

    Wrong bits come first and false content on top, in its order; copies are of what then is told.
    `filters` says whether the receiver refuses a copy by its number.
    """

    link: Link
    gate: PoseGate
    duplication: Duplication | None = None
    filters: bool = True
    bit_errors: BitErrors | None = None
    false: tuple[FalseContent, ...] = ()
    memory: Memory = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Know how much is to be remembered."""
        frozen = [one.span.from_at - 1 for one in self.false if isinstance(one, FrozenContent)]
        ages = [one.age for one in self.false if isinstance(one, ReplayedContent)]
        object.__setattr__(self, "memory", Memory(frozen, max(ages, default=0)))

    def arrive(self, judged: Verdict, sent: GpsPose, passage: Passage) -> Arrival:
        """Work out what the receiver makes of a message that has become visible.

        What its frame check or its gate refuses is dropped as "corrupted", with the gate's word as
        content, if it was that.
        """
        if judged.outcome == "dropped":
            return Arrival(judged, sent, "", 0, [])
        try:
            read = self._read(sent, passage)
            if read is None:
                return Arrival(_corrupted(judged), sent, "", 0, [])
            pose, kinds = self._with_false_content(sent, read)
        except RefusedMessageError as refusal:
            return Arrival(_corrupted(judged), sent, refusal.reason, 0, [])
        copies = self._copies(judged, pose, passage)
        further = [*copies, *self._ghosts(judged, sent)]
        return Arrival(judged, pose, "+".join(kinds), len(copies), further)

    def _read(self, sent: GpsPose, passage: Passage) -> GpsPose | None:
        """The pose that the receiver reads, `sent` if no bit is wrong; None by its frame check.

        Raises RefusedMessageError if its gate refuses what the bits say.
        """
        errors, draw, seq = self.bit_errors, self.link.draw, passage.seq
        if errors is None or not (count := errors.flips(draw, seq, passage.size)):
            return sent
        frame = encode(put_off(sent, FRAMES_SINCE - self.gate.start_at))
        came = flipped(frame, flip_places(draw, seq, count, 8 * len(frame)))
        if errors.is_noticed(frame, came):
            return None
        read = cast("GpsPose", decode(GPS, came, exact=True))
        return self._checked(put_off(read, self.gate.start_at - FRAMES_SINCE), sent)

    def _with_false_content(self, sent: GpsPose, read: GpsPose) -> tuple[GpsPose, list[str]]:
        """The pose that is told, and the kinds of what is false in it."""
        pose, kinds = read, [] if read is sent else ["corrupted"]

        def recall(until: int) -> GpsPose | None:
            # A wrong bit can put the instant of `read` off: what was sent after the message itself
            # has come, or not yet, as the wire pleases.
            return self.memory.newest(min(until, sent.sent_at_ns))

        for one in self.false:
            if sent.sent_at_ns in one.span:
                told = one.tell(pose, self.gate.plane, recall)
                if told is not None:
                    pose = self._checked(told, sent)
                    kinds.append(one.kind)
        return pose, kinds

    def _checked(self, pose: GpsPose, sent: GpsPose) -> GpsPose:
        # By an instant of the message, not of the tick, which the wire may put off.
        self.gate.check(pose, sent.sent_at_ns)
        return pose

    def _copies(self, judged: Verdict, pose: GpsPose, passage: Passage) -> list[Further]:
        law, draw = self.duplication, self.link.draw
        if law is None or not law.copies(draw, passage.seq):
            return []
        if law.delay is not None:
            return [Further(judged.visible_at + law.delay, COPY, pose)]
        effects = self.link.effects_at(passage.sent_at)
        own = combine(effects, draw_of_copy(draw), passage)
        return [Further(max(judged.visible_at, own.visible_at), COPY, pose)]

    def _ghosts(self, judged: Verdict, sent: GpsPose) -> list[Further]:
        ghosts = [
            one
            for one in self.false
            if isinstance(one, GhostVehicle) and sent.sent_at_ns in one.span
        ]
        further = []
        for nth, one in enumerate(ghosts, GHOST):
            with suppress(RefusedMessageError):  # there is nobody beyond the plane
                beside = self._checked(one.beside(sent, self.gate.plane), sent)
                further.append(Further(judged.visible_at + one.after, nth, beside))
        return further


def _corrupted(judged: Verdict) -> Verdict:
    return Verdict("dropped", "corrupted", judged.visible_at)
