"""The verdict of a directed radio link on a message: deliver at an instant, or drop.

The verdict on message `seq` depends on the seed, the link and `seq` alone, and where the link is
changed during the run on when the message was sent; never on the order of arrival, on other links
or on whether `seq - 1` arrived. So it is the same on the wall clock and in virtual time.
"""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from hashlib import blake2b
from operator import attrgetter
from typing import Literal, NamedTuple

from transport.links.laws.basic import Latency
from transport.links.laws.effect import CELL_PURPOSE, Draw, Effect, TransmissionContext
from transport.links.laws.stage import StageLaw
from transport.reasons import DropReason
from vehicles.messages import Outcome

_EVER_SINCE, _FOR_EVER = -(2**63), 2**63 - 1
"""Before and after any instant (ns) of a run."""
_STEPS = 2**52  # so that (k + 1/2) / _STEPS is exact in a double and lies strictly inside (0, 1)


class Verdict(NamedTuple):
    """The link's decision: `reason` is empty when delivered, else a word of the table of reasons.

    `visible_at` (ns) is the instant from which the receiver may know the message, also if dropped.
    """

    outcome: Outcome
    reason: DropReason | Literal[""]
    visible_at: int


def keyed_draw(seed: int, sender: str, receiver: str) -> Draw:
    """Generator of the numbers in (0, 1) of one link, the same on every platform."""
    link = f"{seed}\0{sender}\0{receiver}\0".encode()

    def draw(purpose: str, seq: int) -> float:
        digest = blake2b(link + f"{seq}\0{purpose}".encode(), digest_size=8).digest()
        return ((int.from_bytes(digest, "big") >> 12) + 0.5) / _STEPS

    return draw


def switch_draw(before: Draw, after: Draw, from_seq: int) -> Draw:
    """Draw as `before` for messages before number `from_seq`, else as `after`.

    So chains with memory keep their state. Draws for a cell of time, instead of a message, do not
    change: part of the cell lies before that message.
    """

    def draw(purpose: str, seq: int) -> float:
        past = seq < from_seq or purpose.startswith(CELL_PURPOSE)
        return (before if past else after)(purpose, seq)

    return draw


def combine(effects: Iterable[Effect], draw: Draw, context: TransmissionContext) -> Verdict:
    """Let each effect judge a message: delays add up, the first that drops names the reason."""
    delay = 0
    reason: DropReason | Literal[""] = ""
    for effect in effects:
        judged = effect.judge(draw, context)
        if isinstance(judged, str):
            reason = reason or judged
        else:
            delay += judged
    return Verdict("dropped" if reason else "delivered", reason, context.sent_at + delay)


@dataclass(frozen=True, slots=True)
class ChangedEffects:
    """Effects on messages sent from the instant `from_at` (ns) on, until the next change.

    `floor` is the least delay in ns, below which the wire has to stay.
    """

    from_at: int
    effects: tuple[Effect, ...]
    floor: int = field(init=False)

    def __post_init__(self) -> None:
        floors = (one.floor for one in self.effects if isinstance(one, Latency))
        object.__setattr__(self, "floor", sum(floors))


_from_at = attrgetter("from_at")


@dataclass(slots=True)
class Link:
    """A directed link of a run: judges the messages of one sender on their way to one receiver.

    Its effects judge each message by itself; in `stages` messages depend on one another (`Line`).
    `course` are its changes in order of time.
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

    def redraw(self, from_seq: int, seed: int) -> None:
        """Use another seed for messages from number `from_seq` on."""
        after = keyed_draw(seed, self.sender, self.receiver)
        self.draw = switch_draw(self.draw, after, from_seq)

    def effects_at(self, sent_at: int) -> tuple[Effect, ...]:
        """The effects on a message sent at an instant (ns)."""
        if not self.changes:  # the usual case
            return self.effects
        place = bisect_right(self.changes, sent_at, key=_from_at)
        return self.changes[place - 1].effects if place else self.effects

    def judge(self, context: TransmissionContext) -> Verdict:
        return combine(self.effects_at(context.sent_at), self.draw, context)

    def latest_sent_at(self, now: int) -> int:
        """Last instant (ns) at which a message visible by `now` can have been sent.

        Where the least delay has become shorter, messages sent shortly before may be overtaken.
        """
        if not self.changes:
            return now - self._unchanged.floor
        spells = [self._unchanged, *self.changes]
        ends = [*(one.from_at for one in self.changes), _FOR_EVER]
        found = (
            min(end - 1, now - spell.floor)
            for spell, end in zip(spells, ends, strict=True)
            if spell.from_at < end and spell.from_at + spell.floor <= now
        )
        return max(found)
