"""The stages of one link in a run, in which messages wait until their verdicts are known."""

from collections.abc import Iterable
from heapq import heappop, heappush
from typing import Final

from transport.links.laws.effect import TransmissionContext
from transport.links.laws.stage import StagedMessage
from transport.links.link import Link, Verdict


class StagedMessages:
    """Messages of one link that were judged by its effects and now depend on one another."""

    def __init__(self, link: Link) -> None:
        self._stages = [law.stage() for law in link.stages]
        self._link = link
        self._coming: list[tuple[int, int, StagedMessage]] = []
        self._newest = -1

    def is_late(self, context: TransmissionContext, tick: int) -> bool:
        """Whether messages sent with this one had passed by the tick at `tick` (ns)."""
        return context.sent_at <= self._link.latest_sent_at(tick)

    def is_overtaken(self, context: TransmissionContext) -> bool:
        """Whether a later message than this one has passed, so that it can no longer join."""
        return context.seq <= self._newest

    def join(self, context: TransmissionContext, verdict: Verdict) -> None:
        """Add a message with the verdict of the effects."""
        one = StagedMessage(context, verdict.visible_at, verdict.reason)
        heappush(self._coming, (context.sent_at, context.seq, one))

    def resolve(self, now: int) -> list[tuple[TransmissionContext, Verdict]]:
        """Messages whose verdict is known by the tick at `now` (ns)."""
        until = self._link.latest_sent_at(now)
        moved = []
        while self._coming and self._coming[0][0] <= until:
            _, self._newest, one = heappop(self._coming)
            moved.append(one)
        for stage in self._stages:
            moved = stage.carry(moved, until)
        return [
            (
                one.context,
                Verdict("dropped" if one.reason else "delivered", one.reason, one.visible_at),
            )
            for one in moved
        ]


def judge_stream(link: Link, stream: Iterable[TransmissionContext]) -> list[Verdict]:
    """Verdicts on all messages sent over a link, in the order of their numbers."""
    contexts = sorted(stream, key=lambda one: one.seq)
    if not link.stages:
        return [link.judge(one) for one in contexts]
    line = StagedMessages(link)
    for one in contexts:
        line.join(one, link.judge(one))
    settled = line.resolve(_EVER)
    return [verdict for _, verdict in sorted(settled, key=lambda one: one[0].seq)]


_EVER: Final = 2**63 - 1
