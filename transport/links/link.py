"""What a directed radio link does to a message: a pure verdict, deliver at an instant or drop.

The verdict on message `seq` depends on the seed, the link and `seq` alone, never on the order in
which messages came, on other links or on whether `seq - 1` arrived. So a run on the wall clock and
a run in virtual time judge alike.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import Literal

from transport.links.effects import Effect, Uniform
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


def keyed_uniform(seed: int, sender: str, receiver: str, seq: int, purpose: str) -> float:
    """Return the number in (0, 1) that belongs to this key, the same on every platform."""
    key = "\0".join((str(seed), sender, receiver, str(seq), purpose)).encode()
    drawn = int.from_bytes(blake2b(key, digest_size=8).digest(), "big") >> 12
    return (drawn + 0.5) / _STEPS


def combine(chain: Iterable[Effect], uniform: Uniform, seq: int, measured_at: int) -> Verdict:
    """Let each effect judge message `seq`: delays add up, the first that drops names the reason."""
    delay = 0
    reason: DropReason | Literal[""] = ""
    for effect in chain:
        judged = effect.judge(uniform, seq)
        if isinstance(judged, str):
            reason = reason or judged
        else:
            delay += judged
    return Verdict("dropped" if reason else "delivered", reason, measured_at + delay)


@dataclass(frozen=True, slots=True)
class Link:
    """A directed link of a run: judges the messages of one sender on their way to one receiver."""

    chain: tuple[Effect, ...]
    seed: int
    sender: str
    receiver: str

    def judge(self, seq: int, measured_at: int) -> Verdict:
        """Judge message `seq`, measured at `measured_at` (ns)."""
        uniform = partial(keyed_uniform, self.seed, self.sender, self.receiver, seq)
        return combine(self.chain, uniform, seq, measured_at)
