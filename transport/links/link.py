"""Verdicts of a directed radio link on messages: deliver at an instant, or drop.

The verdict on message `seq` depends on the seed, the link and `seq`, and on the instant of sending
if the link changes during the run. It does not depend on the order of arrival, on other links or on
whether `seq - 1` arrived, so it is the same on the wall clock and in virtual time.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from operator import attrgetter
from typing import Literal, NamedTuple

from transport.links.laws.basic import Latency
from transport.links.laws.effect import Draw, Effect, TransmissionContext
from transport.links.laws.stage import StageLaw
from transport.reasons import DropReason
from vehicles.messages import Outcome

_EVER_SINCE, _FOR_EVER = -(2**63), 2**63 - 1  # Before and after any instant (ns) of a run
_STEPS = 2**52  # (k + 1/2) / _STEPS is exact in a double and strictly inside (0, 1)


class Verdict(NamedTuple):
    """Decision of a link; `reason` is empty if delivered, otherwise one of the table.

    `visible_at` (ns) is the instant from which the receiver may read the message, set also for a
    dropped message.
    """

    outcome: Outcome
    reason: DropReason | Literal[""]
    visible_at: int


def keyed_draw(seed: int, sender: str, receiver: str) -> Draw:
    """Draws in (0, 1) for one link, the same on every platform."""
    link = f"{seed}\0{sender}\0{receiver}\0".encode()

    def draw(purpose: str, seq: int) -> float:
        digest = blake2b(link + f"{seq}\0{purpose}".encode(), digest_size=8).digest()
        return ((int.from_bytes(digest, "big") >> 12) + 0.5) / _STEPS

    return draw


def combine(effects: Iterable[Effect], draw: Draw, context: TransmissionContext) -> Verdict:
    """Combine all effects on a message: delays add up, the first drop gives the reason."""
    delay = 0
    reason: DropReason | Literal[""] = ""
    for effect in effects:
        result = effect.judge(draw, context)
        if isinstance(result, str):
            reason = reason or result
        else:
            delay += result
    return Verdict("dropped" if reason else "delivered", reason, context.sent_at + delay)


@dataclass(frozen=True, slots=True)
class ChangedEffects:
    """Effects on messages sent from the instant `from_at` (ns) until the next change.

    `floor` is the minimum latency (ns); the bus has to be faster.
    """

    from_at: int
    effects: tuple[Effect, ...]
    floor: int = field(init=False)

    def __post_init__(self) -> None:
        floors = (effect.floor for effect in self.effects if isinstance(effect, Latency))
        object.__setattr__(self, "floor", sum(floors))


_from_at = attrgetter("from_at")


@dataclass(slots=True)
class Link:
    """A directed link of a run, from one sender to one receiver.

    `effects` judge each message by itself; in `stages` messages affect each other
    (`StagedMessages`). `changes` are in order of time.
    """

    effects: tuple[Effect, ...]
    seed: int
    sender: str
    receiver: str
    stages: tuple[StageLaw, ...] = ()
    changes: Sequence[ChangedEffects] = ()
    draw: Draw = field(init=False, repr=False, compare=False)
    _unchanged: ChangedEffects = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        self.draw = keyed_draw(self.seed, self.sender, self.receiver)
        self._unchanged = ChangedEffects(_EVER_SINCE, self.effects)

    def effects_at(self, sent_at: int) -> tuple[Effect, ...]:
        """Effects on a message sent at an instant (ns)."""
        if not self.changes:  # the usual case
            return self.effects
        index = bisect_right(self.changes, sent_at, key=_from_at)
        return self.changes[index - 1].effects if index else self.effects

    def judge(self, context: TransmissionContext) -> Verdict:
        return combine(self.effects_at(context.sent_at), self.draw, context)

    def latest_sent_at(self, now: int) -> int:
        """Last instant (ns) at which a message visible by `now` can have been sent.

        If the minimum latency decreases, messages sent shortly before may be overtaken.
        """
        if not self.changes:
            return now - self._unchanged.floor
        periods = [self._unchanged, *self.changes]
        ends = [*(change.from_at for change in self.changes), _FOR_EVER]
        return max(
            min(end - 1, now - period.floor)
            for period, end in zip(periods, ends, strict=True)
            if period.from_at < end and period.from_at + period.floor <= now
        )
