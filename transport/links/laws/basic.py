"""Basic effects of a link: rate, cut, independent loss, constant latency, uniform jitter."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.link_law import (
    UNSENT,
    Delays,
    Draw,
    Effect,
    LinkLaw,
    LinkSetting,
    Losses,
    Stage,
    StagedMessage,
    StageLaw,
    TransmissionContext,
)
from transport.topics import DropReason
from vehicles.schedule import SECOND


@dataclass(frozen=True, slots=True)
class Decimation(Effect):
    """Carries the share `kept` of the messages, evenly spaced and starting with the first.

    `kept` is link rate over source rate: 1/2 carries 0, 2, 4, …; 2/3 carries 0, 2, 3, 5, 6, ….
    """

    kept: Fraction

    key = "rate_hz"
    reason = "rate"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        seq, top, bottom = context.seq, self.kept.numerator, self.kept.denominator
        # Carried message j is the source's first message at or after the j-th period of the link.
        return 0 if seq * top // bottom > (seq - 1) * top // bottom else "rate"


@dataclass(frozen=True, slots=True)
class Cut(Effect):
    """Drops all messages while the link is cut."""

    key = "cut"
    reason = "cut"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "cut"

    def losses(self, distance_m: float | None) -> Losses:
        return Losses.independent(1.0)


@dataclass(frozen=True, slots=True)
class Loss(Effect):
    """Loses each message independently with probability `ratio`."""

    ratio: float

    key = "loss_ratio"
    reason = "loss"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return "loss" if draw("loss", context.seq) < self.ratio else 0

    def losses(self, distance_m: float | None) -> Losses:
        return Losses.independent(self.ratio)


@dataclass(frozen=True, slots=True)
class Latency(Effect):
    """Delays every message by `floor` ns."""

    floor: int

    key = "latency_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return self.floor

    @property
    def delays(self) -> Delays:
        return Delays(float(self.floor), 0.0)


@dataclass(frozen=True, slots=True)
class Jitter(Effect):
    """Delays each message independently, uniformly between 0 and `spread` ns."""

    spread: int

    key = "jitter_ms"

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        return round(draw("jitter", context.seq) * self.spread)

    @property
    def delays(self) -> Delays:
        return Delays(0.5 * self.spread, self.spread**2 / 12.0)


# ---- A queue of limited rate at the sender of a link


class Queue(LinkLaw):
    """First-in first-out queue of limited rate at the sender.

    bytes_per_s     transmission rate
    depth_messages  maximum number of waiting messages, not counting the one being sent
    drop            message dropped from a full queue: the "newest" or the "oldest"

    Messages that are lost on the link occupy the sender, too.
    """

    key = "queue"
    reason = "queue"

    bytes_per_s: Annotated[float, Field(ge=1, le=1_000_000_000)]
    depth_messages: Annotated[int, Field(ge=1, le=10_000)] = 10
    drop: Literal["newest", "oldest"] = "newest"

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        return ()

    @property
    def stages(self) -> tuple[StageLaw, ...]:
        return (self,)

    def service(self, size: int) -> int:
        return round(size * SECOND / self.bytes_per_s)  # ns

    def stage(self) -> Stage:
        return _Sender(self)


@dataclass(slots=True)
class _Sender:
    """State of a queue: when the sender is free (ns), and the waiting messages."""

    law: Queue
    free_at: int = 0
    waiting: deque[StagedMessage] = field(default_factory=deque)

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        """Send waiting messages up to each arrival, then up to `until`.

        If a message arrives as the sender becomes free, a waiting message is sent first.
        """
        decided: list[StagedMessage] = []
        for message in arrived:
            self._send(message.context.sent_at, decided)
            self._join(message, decided)
        self._send(until, decided)
        return decided

    def _send(self, until: int, decided: list[StagedMessage]) -> None:
        while self.waiting:
            first = self.waiting[0]
            begins_at = max(self.free_at, first.context.sent_at)
            if begins_at > until:
                return
            self.waiting.popleft()
            self.free_at = begins_at + self.law.service(first.context.size)
            delay = self.free_at - first.context.sent_at
            decided.append(StagedMessage(first.context, first.visible_at + delay, first.reason))

    def _join(self, message: StagedMessage, decided: list[StagedMessage]) -> None:
        if message.reason in UNSENT:
            decided.append(message)
            return
        now = message.context.sent_at
        # If the sender is free, no message waits, because `_send` has run up to now.
        if self.free_at > now and len(self.waiting) >= self.law.depth_messages:
            dropped = message
            if self.law.drop == "oldest":
                dropped = self.waiting.popleft()
                self.waiting.append(message)
            visible_at = dropped.visible_at + now - dropped.context.sent_at
            decided.append(StagedMessage(dropped.context, visible_at, dropped.reason or "queue"))
        else:
            self.waiting.append(message)
