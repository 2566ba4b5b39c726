"""Alteration of the content of messages on a link.

The verdict is computed when a message arrives from the bus, its content when it becomes visible.
By then all earlier messages have arrived in any order, so that replayed content is the same on
every clock, provided that the bus is faster than the link's minimum latency.
"""

from bisect import bisect_right, insort
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Final, NamedTuple, cast

from transport.codec import RefusedMessageError, decode, encode
from transport.links.laws.content import (
    BitErrors,
    Duplication,
    FalseContent,
    choose_bits,
    copy_draw,
    flip_bits,
    shift_times,
)
from transport.links.laws.link_law import TransmissionContext
from transport.links.link import GPS, HORIZON_NS, Link, PoseGate, Verdict, combine
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose

COPY: Final = 1
GHOST: Final = 2  # Indices of extra poses of a message: its copy, and its ghosts from 2 on
FRAME_EPOCH: Final = 2**60
"""Start of the run (ns, the year 2006) in frames with bit errors: neither the effect of a flipped
bit nor the length of a frame depends on the date."""
_sent_at = attrgetter("sent_at_ns")


@dataclass(slots=True, eq=False)
class Transmission:
    """A message on its link, from its arrival from the bus to its delivery.

    `sent` is the pose as sent, `pose` the pose that the receiver reads. `content` names its false
    contents, `copies` counts the copies added by the channel. `arrived_at` (ns) is 0 if unknown.
    """

    sent: ReceivedPose
    context: TransmissionContext
    verdict: Verdict
    late: bool
    pose: ReceivedPose
    content: str = ""
    copies: int = 0
    arrived_at: int = 0


class ExtraPose(NamedTuple):
    """Copy or ghost of a message, visible at instant `at` (ns); `nth` is COPY, GHOST or more."""

    at: int
    nth: int
    pose: ReceivedPose


class PoseHistory:
    """A sender's poses in the order of sending, as far back as false contents need them.

    Stored are the last poses before certain `moments` (ns), and all of the last `span` ns. A
    message may become visible up to two minutes after a newer one arrived.
    """

    def __init__(self, moments: Iterable[int] = (), span: int = 0) -> None:
        self._last: dict[int, GpsPose | None] = dict.fromkeys(moments)
        self._span = span
        self._poses: list[GpsPose] = []

    def add(self, pose: GpsPose) -> None:
        for moment, last in self._last.items():
            if pose.sent_at_ns <= moment and (last is None or last.sent_at_ns < pose.sent_at_ns):
                self._last[moment] = pose
        if self._span:
            insort(self._poses, pose, key=_sent_at)
            oldest = self._poses[-1].sent_at_ns - self._span - 2 * HORIZON_NS
            while self._poses[0].sent_at_ns < oldest:
                del self._poses[0]

    def newest(self, until: int) -> GpsPose | None:
        """Newest pose sent by the instant `until` (ns); None without any."""
        if until in self._last:
            return self._last[until]
        index = bisect_right(self._poses, until, key=_sent_at)
        return self._poses[index - 1] if index else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ContentStage:
    """Bit errors, false content and copies of delivered messages, in this order.

    With `filters` the receiver refuses copies by their number.
    """

    link: Link
    gate: PoseGate
    duplication: Duplication | None = None
    filters: bool = True
    bit_errors: BitErrors | None = None
    false: tuple[FalseContent, ...] = ()
    history: PoseHistory = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        moments = [moment for law in self.false for moment in law.moments]
        span = max((law.age for law in self.false), default=0)
        object.__setattr__(self, "history", PoseHistory(moments, span))

    def apply(self, transmission: Transmission) -> list[ExtraPose]:
        """Set the pose that the receiver reads; returns its copies and ghosts.

        A message refused by the frame check or the gate is dropped as "corrupted"; the reason of
        the gate becomes its content.
        """
        verdict, sent, context = (
            transmission.verdict,
            transmission.sent.message,
            transmission.context,
        )
        if verdict.outcome == "dropped":
            return []
        try:
            read = self._read(transmission.sent, context)
            if read is None:
                transmission.verdict = _corrupted(verdict)
                return []
            transmission.pose, kinds = self._with_false_content(transmission.sent, read)
        except RefusedMessageError as refusal:
            transmission.verdict, transmission.content = _corrupted(verdict), refusal.reason
            return []
        copies = self._copies(verdict, transmission.pose, context)
        transmission.content, transmission.copies = "+".join(kinds), len(copies)
        return [*copies, *self._ghosts(verdict, sent)]

    def _read(self, sent: ReceivedPose, context: TransmissionContext) -> ReceivedPose | None:
        """The pose as read, `sent` without bit errors; None if the frame check refuses it.

        Raises RefusedMessageError if the gate refuses it.
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
        """The pose that the receiver reads, and the kinds of its false contents."""
        pose, kinds = read, [] if read is sent else ["corrupted"]
        sent_at = sent.message.sent_at_ns

        def recall(until: int) -> GpsPose | None:
            # Bit errors can shift the instant of `read`, and whether later messages have arrived
            # depends on the bus.
            return self.history.newest(min(until, sent_at))

        for law in self.false:
            if sent_at in law.span:
                altered = law.falsify(pose.message, self.gate.plane, recall)
                if altered is not None:
                    pose = self._checked(altered, sent.message)
                    kinds.append(law.kind)
        return pose, kinds

    def _checked(self, message: GpsPose, sent: GpsPose) -> ReceivedPose:
        # The instant of the tick would depend on the bus.
        return self.gate.check(message, sent.sent_at_ns)

    def _copies(
        self, verdict: Verdict, pose: ReceivedPose, context: TransmissionContext
    ) -> list[ExtraPose]:
        law, draw = self.duplication, self.link.draw
        if law is None or not law.copies(draw, context.seq):
            return []
        copy = replace(pose)
        if law.delay is not None:
            return [ExtraPose(verdict.visible_at + law.delay, COPY, copy)]
        effects = self.link.effects_at(context.sent_at)
        own = combine(effects, copy_draw(draw), context)
        return [ExtraPose(max(verdict.visible_at, own.visible_at), COPY, copy)]

    def _ghosts(self, verdict: Verdict, sent: GpsPose) -> list[ExtraPose]:
        laws = [law for law in self.false if law.after is not None and sent.sent_at_ns in law.span]
        ghosts = []
        for nth, law in enumerate(laws, GHOST):
            with suppress(RefusedMessageError):  # beyond the plane
                ghost = self._checked(law.extra_message(sent, self.gate.plane), sent)
                ghosts.append(ExtraPose(verdict.visible_at + (law.after or 0), nth, ghost))
        return ghosts


def _corrupted(verdict: Verdict) -> Verdict:
    return Verdict("dropped", "corrupted", verdict.visible_at)
