"""Base class of user-defined laws of loss."""

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from itertools import accumulate
from math import inf
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from transport.links.laws.link_law import (
    Draw,
    InvalidKeyError,
    LinkLaw,
    Losses,
    Problem,
    Ratio,
    TransmissionContext,
    problems_of,
)
from transport.topics import DropReason


class BaseLoss(LinkLaw):
    """Base of a user-defined law of loss: a Pydantic model whose fields are its parameters.

    `judge` decides on one message. The verdict must depend only on `draw` and `context`, not on
    other messages, so that it is the same on every clock: `draw("mine", context.seq)` is the random
    number in (0, 1) of a purpose and a message. Lost messages have the reason "loss".

    `losses` may state the mean loss in the long run, `Losses.independent(ratio)`, which `convoy
    check` compares with the achieved one; by default it is unknown.
    """

    key: ClassVar[str] = "loss"
    reason: ClassVar[DropReason | None] = "loss"

    def losses(self, distance_m: float | None) -> Losses | None:
        return None


# ---- Markov chains that step with each message number, whether or not the message arrives
#
# The state at a number follows from the keyed draws of the numbers up to it, negative ones
# included. All possible earlier states are followed through the same draws, far enough back that
# they have become one state (coupling from the past: Propp and Wilson, Random Structures and
# Algorithms 9, 1996). Each verdict can therefore be computed alone, and the chain is stationary
# from the start.


LONGEST_LOOK_BACK = 10_000.0  # Mean number of draws of a verdict: 0.01 s
ROUNDING = 1e-12  # Smaller probabilities count as zero

_STEP = "burst"

Map = tuple[int, ...]  # The next state of each state, for one draw


def _no_draw(purpose: str, seq: int) -> float:
    raise AssertionError(f"{purpose} of {seq} is drawn without a link")


class CoupledChain:
    """State of a finite Markov chain at any number; `rows[i][j]` is the probability from i to j.

    A draw u leads from i to the first j at which the cumulative sum of the row exceeds u. The chain
    has the states that are reached from `start`. Raises ValueError if they rarely couple.

    The last state is cached for one link, so that a stream costs one draw per message.
    """

    def __init__(self, rows: Sequence[Sequence[float]], start: int) -> None:
        self.rows = np.array(rows, dtype=float)
        sums = [list(accumulate(row)) for row in rows]
        inner = {total for row in sums for total in row if 0.0 < total < 1.0}
        self._cuts = sorted(inner)
        self._maps = [_map(sums, cut) for cut in (0.0, *self._cuts)]
        self._widths = np.diff([0.0, *self._cuts, 1.0])
        self.states = self._reached(start)
        self.mean_look_back = self._mean_look_back()
        if not 0.0 <= self.mean_look_back <= LONGEST_LOOK_BACK:
            raise ValueError("its state depends on the distant past")
        self._known: tuple[Draw, int, int] = (_no_draw, 0, 0)

    def state_at(self, draw: Draw, seq: int) -> int:
        drawn, number, state = self._known
        if drawn is draw and number == seq - 1:
            state = self._maps[bisect_right(self._cuts, draw(_STEP, seq))][state]
        else:
            state = self._look_back(draw, seq)
        self._known = draw, seq, state
        return state

    def _look_back(self, draw: Draw, seq: int) -> int:
        """Look back until all states have coupled, or to the cached state."""
        drawn, number, known = self._known
        through: Map = tuple(range(len(self.rows)))
        while drawn is not draw or number != seq:
            step = self._maps[bisect_right(self._cuts, draw(_STEP, seq))]
            through = tuple(through[state] for state in step)
            coupled = {through[state] for state in self.states}
            if len(coupled) == 1:
                return coupled.pop()
            seq -= 1
        return through[known]

    def _reached(self, start: int) -> tuple[int, ...]:
        reached, new = {start}, {start}
        while new:
            new = {step[state] for step in self._maps for state in new} - reached
            reached |= new
        return tuple(sorted(reached))

    def _mean_look_back(self) -> float:
        """Mean number of draws until all states have coupled; not in [0, inf) if they never do.

        It is the same forwards and backwards: sets of states shrink until one state is left.
        """
        whole = frozenset(self.states)
        indices, new = {whole: 0}, [whole]
        while new:
            images = {
                frozenset(step[state] for state in states) for states in new for step in self._maps
            }
            new = sorted((image for image in images - indices.keys() if len(image) > 1), key=sorted)
            indices |= {image: len(indices) + index for index, image in enumerate(new)}
        if len(whole) == 1:
            return 0.0
        stays = np.zeros((len(indices), len(indices)))
        for states, index in indices.items():
            for step, width in zip(self._maps, self._widths, strict=True):
                image = frozenset(step[state] for state in states)
                if len(image) > 1:
                    stays[index, indices[image]] += width
        try:
            return float(np.linalg.solve(np.eye(len(indices)) - stays, np.ones(len(indices)))[0])
        except np.linalg.LinAlgError:
            return inf

    @cached_property
    def shares(self) -> np.ndarray:
        """Stationary distribution over the states."""
        equations = np.vstack((self.rows.T - np.eye(len(self.rows)), np.ones(len(self.rows))))
        unreached = [state for state in range(len(self.rows)) if state not in self.states]
        zeros = np.zeros((len(unreached), len(self.rows)))
        zeros[range(len(unreached)), unreached] = 1.0
        targets = np.zeros(len(equations) + len(zeros))
        targets[len(self.rows)] = 1.0
        shares = np.linalg.lstsq(np.vstack((equations, zeros)), targets)[0]
        shares[shares < ROUNDING] = 0.0
        return np.asarray(shares / shares.sum())


def _map(sums: Sequence[Sequence[float]], drawn: float) -> Map:
    """Next state of each state; the last possible state of a row takes the rounding error."""
    return tuple(min(bisect_right(row, drawn), _last(row)) for row in sums)


def _last(row: Sequence[float]) -> int:
    return max(state for state, total in enumerate(row) if state == 0 or total > row[state - 1])


# ---- Burst losses by a Markov chain: Gilbert–Elliott model, and the four states of netem


_FATE = "burst fate"


class ChainLoss(LinkLaw):
    """Base of losses by the state of a Markov chain."""

    key = "loss"
    reason = "burst"

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain; raises InvalidKeyError."""
        raise NotImplementedError

    @cached_property
    def loss_by_state(self) -> tuple[float, ...]:
        raise NotImplementedError

    def problems(self) -> Iterator[Problem]:
        return problems_of(lambda: self.chain)

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        loss = self.loss_by_state[self.chain.state_at(draw, context.seq)]
        if loss in {0.0, 1.0}:
            return "burst" if loss else 0
        return "burst" if draw(_FATE, context.seq) < loss else 0

    def losses(self, distance_m: float | None) -> Losses:
        """Loss and burst in the stationary state.

        The mean burst is P(lost) / P(lost and the next one delivered).
        """
        rows, shares = self.chain.rows, self.chain.shares
        loss_by_state = np.array(self.loss_by_state)
        lost = float(np.clip(shares @ loss_by_state, 0.0, 1.0))
        last = float((shares * loss_by_state) @ rows @ (1.0 - loss_by_state))
        burst = (lost / last if last > ROUNDING else inf) if lost else None
        return Losses(lost, burst)


def build_chain(
    key: str, probabilities: Sequence[float], chain: Callable[[], CoupledChain]
) -> CoupledChain:
    """Build a chain; raises InvalidKeyError at `key` if its state cannot be computed."""
    try:
        return chain()
    except ValueError as error:
        values = ", ".join(f"{probability:g}" for probability in probabilities)
        raise InvalidKeyError(
            key,
            f"given {values}, {error}; allowed an aperiodic chain whose state depends on fewer "
            "than 10000 messages on average",
        ) from error


class GilbertElliott(ChainLoss):
    """Gilbert–Elliott model: a good and a bad state, by probabilities or by mean values.

    good_to_bad_ratio     p, probability of good → bad before a message
    bad_to_good_ratio     r, probability of bad → good before a message
    bad_delivered_ratio   h, delivery ratio in the bad state, default 0
    good_delivered_ratio  k, delivery ratio in the good state, default 1
    loss_ratio            mean loss, in place of the probabilities (h = 0, k = 1)
    burst_messages_mean   mean number of messages lost in a row, together with loss_ratio

    With h = 0 and k = 1 (Gilbert's simple model) the loss is p / (p + r), the mean burst 1 / r
    messages, and the autocorrelation of losses at lag m is (1 - p - r)^m. Sources: Gilbert, Bell
    System Technical Journal 39, 1960; Elliott, ibid. 42, 1963. The state changes before each
    message; in Linux netem after it. The long-run loss is the same.
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
        """The numbers p, r, h and k; raises InvalidKeyError."""
        by_burst = {"loss_ratio", "burst_messages_mean"}
        keys = set(type(self).model_fields) - {"kind"}
        given = {key for key in keys if getattr(self, key) is not None}
        if given & by_burst and given - by_burst:
            key, other = min(given - by_burst), min(given & by_burst)
            allowed = "allowed probabilities or mean values"
            raise InvalidKeyError(key, f"given together with {other}, {allowed}")
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
        """The chain, bad state first: draws below both of its probabilities couple the states."""
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


class FourState(ChainLoss):
    """Four-state model of Linux netem (`loss state`).

    gap_to_burst_ratio   p13, probability that a burst begins with the message
    burst_to_gap_ratio   p31, probability that the burst ends after a lost message
    lost_to_sent_ratio   p32, probability of a delivery after a loss within the burst; "sent" means
                         delivered
    sent_to_lost_ratio   p23, probability of a loss after such a delivery
    isolated_loss_ratio  p14, probability of an isolated loss outside bursts

    States: 1 delivered outside bursts, 2 delivered within a burst, 3 lost within a burst, 4
    isolated loss, which 1 follows. The new state decides about the message. The chain has the
    states that are reached from 1 and is stationary from the first message; netem starts in 1.
    Sources: sch_netem.c; Salsano, Ludovici, Ordine and Giannuzzi, Definition of a general and
    intuitive loss model for packet networks, 2012.
    """

    kind: Literal["four_state"] = "four_state"
    gap_to_burst_ratio: Ratio | None = None
    burst_to_gap_ratio: Ratio | None = None
    lost_to_sent_ratio: Ratio = 0.0
    sent_to_lost_ratio: Ratio = 1.0
    isolated_loss_ratio: Ratio = 0.0

    @cached_property
    def probabilities(self) -> dict[str, float]:
        """The probabilities by netem's names; raises InvalidKeyError."""
        p13, p31 = self.required("gap_to_burst_ratio"), self.required("burst_to_gap_ratio")
        p32, p23, p14 = self.lost_to_sent_ratio, self.sent_to_lost_ratio, self.isolated_loss_ratio
        if p13 + p14 > 1.0:
            allowed = f"at most {1.0 - p13:g}, because gap_to_burst_ratio is {p13:g}"
            raise InvalidKeyError("isolated_loss_ratio", f"given {p14:g}, allowed {allowed}")
        if p31 + p32 > 1.0:
            allowed = f"at most {1.0 - p31:g}, because burst_to_gap_ratio is {p31:g}"
            raise InvalidKeyError("lost_to_sent_ratio", f"given {p32:g}, allowed {allowed}")
        return {"p13": p13, "p31": p31, "p32": p32, "p23": p23, "p14": p14}

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain in the order 3, 4, 2, 1: small draws lose, large draws deliver."""
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
