"""Messages of a link with stages, which wait until their verdicts are final."""

from collections.abc import Iterable
from heapq import heappop, heappush
from typing import Final

from transport.links.laws.effect import TransmissionContext
from transport.links.laws.stage import StagedMessage
from transport.links.link import Link, Verdict


class StagedMessages:
    """Messages of one link in its stages, after the verdicts of its effects."""

    def __init__(self, link: Link) -> None:
        self._stages = [law.stage() for law in link.stages]
        self._link = link
        self._pending: list[tuple[int, int, StagedMessage]] = []
        self._newest = -1

    def is_late(self, context: TransmissionContext, tick: int) -> bool:
        """Whether messages sent at the same instant were already decided at `tick` (ns)."""
        return context.sent_at <= self._link.latest_sent_at(tick)

    def is_overtaken(self, context: TransmissionContext) -> bool:
        """Whether a later message was already decided, so that this one can no longer join."""
        return context.seq <= self._newest

    def join(self, context: TransmissionContext, verdict: Verdict) -> None:
        """Add a message with the verdict of the effects."""
        message = StagedMessage(context, verdict.visible_at, verdict.reason)
        heappush(self._pending, (context.sent_at, context.seq, message))

    def resolve(self, now: int) -> list[tuple[TransmissionContext, Verdict]]:
        """Messages whose verdicts became final by the tick at `now` (ns)."""
        until = self._link.latest_sent_at(now)
        messages = []
        while self._pending and self._pending[0][0] <= until:
            _, self._newest, message = heappop(self._pending)
            messages.append(message)
        for stage in self._stages:
            messages = stage.carry(messages, until)
        return [
            (
                message.context,
                Verdict(
                    "dropped" if message.reason else "delivered", message.reason, message.visible_at
                ),
            )
            for message in messages
        ]


def judge_stream(link: Link, stream: Iterable[TransmissionContext]) -> list[Verdict]:
    """Verdicts on all messages sent over a link, in the order of their numbers."""
    contexts = sorted(stream, key=lambda context: context.seq)
    if not link.stages:
        return [link.judge(context) for context in contexts]
    staged = StagedMessages(link)
    for context in contexts:
        staged.join(context, link.judge(context))
    final = staged.resolve(_FOREVER)
    return [verdict for _, verdict in sorted(final, key=lambda pair: pair[0].seq)]


_FOREVER: Final = 2**63 - 1
