"""A queue of bounded rate at the sender of a link."""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import Field

from transport.links.laws.effect import Effect
from transport.links.laws.link_law import LinkLaw, LinkSetting
from transport.links.laws.stage import UNSENT, Stage, StagedMessage, StageLaw
from vehicles.schedule import SECOND


class Queue(LinkLaw):
    """A sender that sends `bytes_per_s`, first come first served, with `depth_messages` waiting.

    A message takes its size over the rate to be sent, and what comes meanwhile waits. With a full
    queue, the new one is dropped, or the one that has waited longest. What is being sent is
    not among those that wait. A message that is lost on its way has taken its turn all the same.
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
        """Time in ns that `size` bytes take."""
        return round(size * SECOND / self.bytes_per_s)

    def stage(self) -> Stage:
        return _Sender(self)

    def describe(self) -> str:
        rate, depth = self.bytes_per_s, self.depth_messages
        return f"queue of {depth} messages at {rate:g} bytes/s, drops the {self.drop}"


@dataclass(slots=True)
class _Sender:
    """A queue in use: when the sender is free (ns), and who waits."""

    law: Queue
    free_at: int = 0
    waiting: deque[StagedMessage] = field(default_factory=deque)

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        """Send what can begin to be sent until each arrival, and until `until`.

        Of a message that arrives as another ends, the one that waits comes first.
        """
        decided: list[StagedMessage] = []
        for one in arrived:
            self._send(one.context.sent_at, decided)
            self._join(one, decided)
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
            longer = self.free_at - first.context.sent_at
            decided.append(StagedMessage(first.context, first.visible_at + longer, first.reason))

    def _join(self, one: StagedMessage, decided: list[StagedMessage]) -> None:
        if one.reason in UNSENT:
            decided.append(one)
            return
        # If the sender is free, no message waits: those that could begin by now have begun.
        if self.free_at > one.context.sent_at and len(self.waiting) >= self.law.depth_messages:
            out = one
            if self.law.drop == "oldest":
                out = self.waiting.popleft()
                self.waiting.append(one)
            waited = one.context.sent_at - out.context.sent_at
            decided.append(
                StagedMessage(out.context, out.visible_at + waited, out.reason or "queue")
            )
        else:
            self.waiting.append(one)
