"""Messages on a link, and their content as the channel alters it.

The verdict is computed when a message comes off the bus, its content when it becomes visible: by
then all earlier messages have come as well, in any order. So replayed content is the same on every
clock, as long as the wire stays below the link's least delay.
"""

from bisect import bisect_right, insort
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Final, NamedTuple, cast

from transport.codec import RefusedMessageError, decode, encode
from transport.links.gate import GPS, HORIZON_NS, PoseGate
from transport.links.laws.content import BitErrors, Duplication, choose_bits, copy_draw, flip_bits
from transport.links.laws.effect import TransmissionContext
from transport.links.laws.false_content import FalseContent, shift_times
from transport.links.link import Link, Verdict, combine
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose

COPY: Final = 1
GHOST: Final = 2
"""Numbers of further poses of a message: its copy, and from this number on its ghosts."""
FRAME_EPOCH: Final = 2**60
"""Instant (ns, the year 2006) of the run's start in frames whose bits are flipped, so that neither
the effect of a flipped bit nor the length of a frame depends on the day of the run."""
_sent_at = attrgetter("sent_at_ns")


@dataclass(slots=True, eq=False)
class Transmission:
    """One message on its link, from its arrival off the bus until it is delivered.

    `sent` is the pose as it was sent, `pose` the pose that the receiver reads; `content` names what
    is false in it, `copies` counts the copies that the channel adds.
    """

    sent: ReceivedPose
    context: TransmissionContext
    verdict: Verdict
    late: bool
    pose: ReceivedPose
    content: str = ""
    copies: int = 0


class ExtraPose(NamedTuple):
    """A copy or ghost of a message, visible from instant `at` (ns); `nth` is COPY or from GHOST."""

    at: int
    nth: int
    pose: ReceivedPose


class PoseHistory:
    """A sender's poses in the order of sending, as far back as false content needs them.

    It needs the last ones until certain `moments` (ns), and all for `span` ns. A visible message
    may have been sent up to two minutes before the newest.
    """

    def __init__(self, moments: Iterable[int] = (), span: int = 0) -> None:
        self._last: dict[int, GpsPose | None] = dict.fromkeys(moments)
        self._span = span
        self._poses: list[GpsPose] = []

    def note(self, pose: GpsPose) -> None:
        for moment, last in self._last.items():
            if pose.sent_at_ns <= moment and (last is None or last.sent_at_ns < pose.sent_at_ns):
                self._last[moment] = pose
        if self._span:
            insort(self._poses, pose, key=_sent_at)
            oldest = self._poses[-1].sent_at_ns - self._span - 2 * HORIZON_NS
            while self._poses[0].sent_at_ns < oldest:
                del self._poses[0]

    def newest(self, until: int) -> GpsPose | None:
        """Newest pose sent by the instant `until` (ns), None without any."""
        if until in self._last:
            return self._last[until]
        place = bisect_right(self._poses, until, key=_sent_at)
        return self._poses[place - 1] if place else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentStage:
    """Wrong bits, false content and copies of the messages that a link delivers, in this order.

    `filters` states whether the receiver refuses a copy by its number.
    """

    link: Link
    gate: PoseGate
    duplication: Duplication | None = None
    filters: bool = True
    bit_errors: BitErrors | None = None
    false: tuple[FalseContent, ...] = ()
    history: PoseHistory = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        moments = [moment for one in self.false for moment in one.moments]
        span = max((one.age for one in self.false), default=0)
        object.__setattr__(self, "history", PoseHistory(moments, span))

    def arrive(self, one: Transmission) -> list[ExtraPose]:
        """Set the pose that the receiver reads of a visible message; returns its copies and ghosts.

        A message refused by the frame check or the gate is dropped as "corrupted", in the latter
        case with the gate's word as content.
        """
        judged, sent, context = one.verdict, one.sent.message, one.context
        if judged.outcome == "dropped":
            return []
        try:
            read = self._read(one.sent, context)
            if read is None:
                one.verdict = _corrupted(judged)
                return []
            one.pose, kinds = self._with_false_content(one.sent, read)
        except RefusedMessageError as refusal:
            one.verdict, one.content = _corrupted(judged), refusal.reason
            return []
        copies = self._copies(judged, one.pose, context)
        one.content, one.copies = "+".join(kinds), len(copies)
        return [*copies, *self._ghosts(judged, sent)]

    def _read(self, sent: ReceivedPose, context: TransmissionContext) -> ReceivedPose | None:
        """The pose that the receiver reads, `sent` if no bit is wrong; None by its frame check.

        Raises RefusedMessageError if its gate refuses the bits.
        """
        errors, draw, seq = self.bit_errors, self.link.draw, context.seq
        if errors is None or not (count := errors.flips(draw, seq, context.size)):
            return sent
        frame = encode(shift_times(sent.message, FRAME_EPOCH - self.gate.start_at))
        came = flip_bits(frame, choose_bits(draw, seq, count, 8 * len(frame)))
        if errors.is_detected(frame, came):
            return None
        read = cast("GpsPose", decode(GPS, came, exact=True))
        return self._checked(shift_times(read, self.gate.start_at - FRAME_EPOCH), sent.message)

    def _with_false_content(
        self, sent: ReceivedPose, read: ReceivedPose
    ) -> tuple[ReceivedPose, list[str]]:
        """The pose that the receiver reads, and the kinds of what is false in it."""
        pose, kinds = read, [] if read is sent else ["corrupted"]
        sent_at = sent.message.sent_at_ns

        def recall(until: int) -> GpsPose | None:
            # A wrong bit can move the instant of `read`, and whether messages sent after this one
            # have come depends on the wire.
            return self.history.newest(min(until, sent_at))

        for one in self.false:
            if sent_at in one.span:
                altered = one.falsify(pose.message, self.gate.plane, recall)
                if altered is not None:
                    pose = self._checked(altered, sent.message)
                    kinds.append(one.kind)
        return pose, kinds

    def _checked(self, message: GpsPose, sent: GpsPose) -> ReceivedPose:
        # By an instant of the message, not of the tick, which depends on the wire.
        return self.gate.check(message, sent.sent_at_ns)

    def _copies(
        self, judged: Verdict, pose: ReceivedPose, context: TransmissionContext
    ) -> list[ExtraPose]:
        law, draw = self.duplication, self.link.draw
        if law is None or not law.copies(draw, context.seq):
            return []
        copy = replace(pose)
        if law.delay is not None:
            return [ExtraPose(judged.visible_at + law.delay, COPY, copy)]
        effects = self.link.effects_at(context.sent_at)
        own = combine(effects, copy_draw(draw), context)
        return [ExtraPose(max(judged.visible_at, own.visible_at), COPY, copy)]

    def _ghosts(self, judged: Verdict, sent: GpsPose) -> list[ExtraPose]:
        ghosts = [
            one for one in self.false if one.after is not None and sent.sent_at_ns in one.span
        ]
        extra = []
        for nth, one in enumerate(ghosts, GHOST):
            with suppress(RefusedMessageError):  # no vehicle is beyond the plane
                beside = self._checked(one.extra_message(sent, self.gate.plane), sent)
                extra.append(ExtraPose(judged.visible_at + (one.after or 0), nth, beside))
        return extra


def _corrupted(judged: Verdict) -> Verdict:
    return Verdict("dropped", "corrupted", judged.visible_at)
