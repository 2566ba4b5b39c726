"""What a directed radio link does to a message: a pure verdict, deliver at an instant or drop.

The verdict on message `seq` depends on the seed, the link and `seq` alone, never on the order in
which messages came, on other links or on whether `seq - 1` arrived. So a run on the wall clock and
a run in virtual time judge alike.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from hashlib import blake2b
from typing import Literal

from transport.links.laws.effect import Draw, Effect, Passage
from transport.links.laws.plain import Latency
from transport.links.laws.queue import StageLaw
from transport.reasons import DropReason
from vehicles.messages import Outcome

_STEPS = 2**52  # so that (k + 1/2) / _STEPS is exact in a double and lies strictly inside (0, 1)


@dataclass(frozen=True, slots=True)
class Verdict:
    """The link's decision: `reason` is empty when delivered, else a word of the table of reasons.

    `visible_at` (ns) is the instant from which the receiver may know the message, or would have
    known it had it not been dropped.
    """

    outcome: Outcome
    reason: DropReason | Literal[""]
    visible_at: int


def keyed_draw(seed: int, sender: str, receiver: str) -> Draw:
    """Return what draws the numbers in (0, 1) of one link, the same on every platform."""
    link = f"{seed}\0{sender}\0{receiver}\0".encode()

    def draw(purpose: str, seq: int) -> float:
        digest = blake2b(link + f"{seq}\0{purpose}".encode(), digest_size=8).digest()
        return ((int.from_bytes(digest, "big") >> 12) + 0.5) / _STEPS

    return draw


def combine(chain: Iterable[Effect], draw: Draw, passage: Passage) -> Verdict:
    """Let each effect judge a message: delays add up, the first that drops names the reason."""
    delay = 0
    reason: DropReason | Literal[""] = ""
    for effect in chain:
        judged = effect.judge(draw, passage)
        if isinstance(judged, str):
            reason = reason or judged
        else:
            delay += judged
    return Verdict("dropped" if reason else "delivered", reason, passage.sent_at + delay)


@dataclass(frozen=True, slots=True)
class Link:
    """A directed link of a run: judges the messages of one sender on their way to one receiver.

    Its effects judge each message by itself; what `stages` add depends on the others, see Line.
    """

    chain: tuple[Effect, ...]
    seed: int
    sender: str
    receiver: str
    stages: tuple[StageLaw, ...] = ()
    draw: Draw = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Key the draws."""
        object.__setattr__(self, "draw", keyed_draw(self.seed, self.sender, self.receiver))

    @property
    def floor(self) -> int:
        """The least delay in ns, which the wire has to beat."""
        return sum(effect.floor for effect in self.chain if isinstance(effect, Latency))

    def judge(self, passage: Passage) -> Verdict:
        """Judge one message by the effects."""
        return combine(self.chain, self.draw, passage)
