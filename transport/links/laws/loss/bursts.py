"""Losses in bursts by the state of a Markov chain: Gilbert–Elliott, and four states as in netem."""

from collections.abc import Callable, Sequence
from functools import cached_property
from math import inf
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.link_law import InvalidKeyError, LinkLaw, Ratio
from transport.links.laws.loss.chains import ROUNDING, CoupledChain
from transport.links.laws.moments import Losses, LossStates
from transport.reasons import DropReason

_FATE = "burst fate"


class ChainLoss(LinkLaw):
    """Base of laws that lose by the state of a Markov chain."""

    key = "loss"
    reason = "burst"

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain; raises Unfit."""
        raise NotImplementedError

    @cached_property
    def loss_by_state(self) -> tuple[float, ...]:
        raise NotImplementedError

    def check(self) -> None:
        _ = self.chain

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        loss = self.loss_by_state[self.chain.state_at(draw, context.seq)]
        if loss in {0.0, 1.0}:
            return "burst" if loss else 0
        return "burst" if draw(_FATE, context.seq) < loss else 0

    @property
    def states(self) -> LossStates:
        return LossStates(self.chain.rows, self.chain.shares, np.array(self.loss_by_state))

    def losses(self, distance_m: float | None) -> Losses:
        """Loss of each state by the time spent in it, over the states that are reached.

        The mean burst is the share lost over the share lost just before one that is not.
        """
        reached = list(self.chain.states)
        rows, shares, loss_by_state = self.states
        within = LossStates(rows[np.ix_(reached, reached)], shares[reached], loss_by_state[reached])
        lost = float(np.clip(shares @ loss_by_state, 0.0, 1.0))
        last = float((shares * loss_by_state) @ rows @ (1.0 - loss_by_state))
        burst = (lost / last if last > ROUNDING else inf) if lost else None
        return Losses(lost, burst, within.covariances)

    def _loss_and_burst(self) -> str:
        losses = self.losses(None)
        in_a_row = f", {losses.burst:.4g} messages in a row on average" if losses.burst else ""
        return f"loss {losses.loss:.4g}{in_a_row}"


def build_chain(
    key: str, probabilities: Sequence[float], chain: Callable[[], CoupledChain]
) -> CoupledChain:
    """Build a chain, or raise Unfit at `key` if it has no stationary state that can be found."""
    try:
        return chain()
    except ValueError as error:
        value = ", ".join(f"{one:g}" for one in probabilities)
        raise InvalidKeyError(
            key,
            f"given {value}, {error}; allowed a chain that does within 10000 messages on average, "
            "and does not go round in a circle",
        ) from error


class GilbertElliott(ChainLoss):
    """A good and a bad state of the link: by its chances, or by mean loss and mean burst.

    good_to_bad_ratio     p, chance of the link turning bad before a message
    bad_to_good_ratio     r, chance of its turning good
    bad_delivered_ratio   h, share of messages delivered in the bad state
    good_delivered_ratio  k, share delivered in the good state
    loss_ratio            in place of them: mean loss ...
    burst_messages_mean   ... and mean number lost in a row (with h = 0, k = 1)

    With h = 0 and k = 1 it is Gilbert's simple model: the loss is p / (p + r), bursts last 1 / r
    messages on average, and the autocorrelation of loss at lag m is (1 - p - r)^m. Sources:
    Gilbert, Bell System Technical Journal 39, 1960; Elliott, ibid. 42, 1963.

    A message is judged by the state after the change that belongs to it. Linux netem judges before
    the change and starts in the good state; in the long run both are the same.
    """

    kind: Literal["gilbert_elliott"] = "gilbert_elliott"
    good_to_bad_ratio: Ratio | None = None
    bad_to_good_ratio: Ratio | None = None
    bad_delivered_ratio: Ratio | None = None
    good_delivered_ratio: Ratio | None = None
    loss_ratio: Ratio | None = None
    burst_messages_mean: Annotated[float, Field(ge=1, le=10_000)] | None = None

    @cached_property
    def probabilities(self) -> tuple[float, float, float, float]:
        """The numbers p, r, h and k; raises Unfit."""
        by_burst = {"loss_ratio", "burst_messages_mean"}
        every = set(type(self).model_fields) - {"kind"}
        given = {key for key in every if getattr(self, key) is not None}
        if given & by_burst and given - by_burst:
            key, other = min(given - by_burst), min(given & by_burst)
            raise InvalidKeyError(
                key, f"given together with {other}, allowed chances or mean values"
            )
        if given & by_burst:
            loss, burst = self.required("loss_ratio"), self.required("burst_messages_mean")
            if loss == 1.0 or burst < loss / (1.0 - loss):
                least = f"at least {loss / (1.0 - loss):g}" if loss < 1.0 else "a loss below 1"
                why = f"given {burst:g} with a loss of {loss:g}, allowed {least}"
                raise InvalidKeyError("burst_messages_mean", why)
            return loss / ((1.0 - loss) * burst), 1.0 / burst, 0.0, 1.0
        p, r = self.required("good_to_bad_ratio"), self.required("bad_to_good_ratio")
        h = 0.0 if self.bad_delivered_ratio is None else self.bad_delivered_ratio
        k = 1.0 if self.good_delivered_ratio is None else self.good_delivered_ratio
        return p, r, h, k

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain, the bad state first: a draw below both chances of it forgets."""
        p, r, *delivered = self.probabilities
        rows = ((1.0 - r, r), (p, 1.0 - p))
        by_burst = self.burst_messages_mean is not None
        key = "burst_messages_mean" if by_burst else "bad_to_good_ratio"
        given = (self.loss_ratio or 0.0, 1.0 / r) if by_burst else (p, r, *delivered)
        return build_chain(key, given, lambda: CoupledChain(rows, start=1))

    @cached_property
    def loss_by_state(self) -> tuple[float, ...]:
        _, _, h, k = self.probabilities
        return 1.0 - h, 1.0 - k

    def describe(self) -> str:
        p, r, h, k = self.probabilities
        numbers = f"p {p:.4g}, r {r:.4g}, h {h:.4g}, k {k:.4g}"
        return f"Gilbert–Elliott: {self._loss_and_burst()} ({numbers})"


class FourState(ChainLoss):
    """The four states of netem: sent in a gap 1, sent in a burst 2, lost in it 3, lost alone 4.

    gap_to_burst_ratio   p13, chance of a burst to begin with the message
    burst_to_gap_ratio   p31, chance of it to end after a loss
    lost_to_sent_ratio   p32, chance of a message sent after a loss, within the burst
    sent_to_lost_ratio   p23, chance of a loss after such a message
    isolated_loss_ratio  p14, chance of a loss alone, in the gap

    The new state is the message's fate, and after 4 follows 1. Source: sch_netem.c of Linux;
    Salsano, Ludovici, Ordine and Giannuzzi, Definition of a general and intuitive loss model for
    packet networks, 2012. The states that matter are those reached from 1, where netem starts; here
    the chain is stationary from the first message on.
    """

    kind: Literal["four_state"] = "four_state"
    gap_to_burst_ratio: Ratio | None = None
    burst_to_gap_ratio: Ratio | None = None
    lost_to_sent_ratio: Ratio = 0.0
    sent_to_lost_ratio: Ratio = 1.0
    isolated_loss_ratio: Ratio = 0.0

    @cached_property
    def probabilities(self) -> dict[str, float]:
        """The five numbers by netem's names; raises Unfit."""
        p13, p31 = self.required("gap_to_burst_ratio"), self.required("burst_to_gap_ratio")
        p32, p23, p14 = self.lost_to_sent_ratio, self.sent_to_lost_ratio, self.isolated_loss_ratio
        if p13 + p14 > 1.0:
            allowed = f"at most {1.0 - p13:g}, for gap_to_burst_ratio is {p13:g}"
            raise InvalidKeyError("isolated_loss_ratio", f"given {p14:g}, allowed {allowed}")
        if p31 + p32 > 1.0:
            allowed = f"at most {1.0 - p31:g}, for burst_to_gap_ratio is {p31:g}"
            raise InvalidKeyError("lost_to_sent_ratio", f"given {p32:g}, allowed {allowed}")
        return {"p13": p13, "p31": p31, "p32": p32, "p23": p23, "p14": p14}

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain in the order 3, 4, 2, 1: a small draw loses, a large one delivers."""
        p13, p31, p32, p23, p14 = self.probabilities.values()
        rows = (
            (1.0 - p31 - p32, 0.0, p32, p31),
            (0.0, 0.0, 0.0, 1.0),
            (p23, 0.0, 1.0 - p23, 0.0),
            (p13, p14, 0.0, 1.0 - p13 - p14),
        )
        given = tuple(self.probabilities.values())
        return build_chain("burst_to_gap_ratio", given, lambda: CoupledChain(rows, start=3))

    @cached_property
    def loss_by_state(self) -> tuple[float, ...]:
        return 1.0, 1.0, 0.0, 0.0

    def describe(self) -> str:
        numbers = ", ".join(f"{name} {value:.4g}" for name, value in self.probabilities.items())
        return f"four states as in netem: {self._loss_and_burst()} ({numbers})"
