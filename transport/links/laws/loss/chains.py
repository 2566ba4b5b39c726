"""Losses in bursts: Markov chains that step with each message, sent or never come.

The state at any number follows from the draws of the numbers up to it, which exist below zero too.
All states that the past may have left are followed through one and the same draw of each number;
looking back far enough they have all become one, and what was before does not matter (coupling from
the past: Propp and Wilson, Random Structures and Algorithms 9, 1996). So any verdict can be
computed alone, and the chain is exactly stationary from the first message on.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import accumulate
from math import inf

import numpy as np

from transport.links.laws.effect import Draw, TransmissionContext
from transport.links.laws.law import LinkLaw, Unfit
from transport.links.laws.moments import Losses, LossStates
from transport.reasons import DropReason

LONGEST_LOOK_BACK = 10_000.0
"""Draws that one verdict alone may cost on average: a hundredth of a second."""

_ROUNDING = 1e-12
"""Chances below it are none."""

_STEP, _FATE = "burst", "burst fate"

Map = tuple[int, ...]
"""The next state of each state, under one draw."""


def _nobody(purpose: str, seq: int) -> float:
    raise AssertionError(f"no link draws {purpose} of {seq} so")


class CoupledChain:
    """State of a finite Markov chain at any number; `rows[i][j]` is the chance from i to j.

    A draw u leads from i to the first j at which the row's sum exceeds u. Chains start in any of
    the states reached from `start`. Raises ValueError where they hardly ever meet.

    The last state is remembered, for one link, so that a stream costs one draw for each message.
    """

    def __init__(self, rows: Sequence[Sequence[float]], start: int) -> None:
        self.rows = np.array(rows, dtype=float)
        sums = [list(accumulate(row)) for row in rows]
        inner = {one for row in sums for one in row if 0.0 < one < 1.0}
        self._cuts = sorted(inner)
        self._maps = [_map(sums, cut) for cut in (0.0, *self._cuts)]
        self._widths = np.diff([0.0, *self._cuts, 1.0])
        self.states = self._reached(start)
        self.mean_look_back = self._mean_look_back()
        if not 0.0 <= self.mean_look_back <= LONGEST_LOOK_BACK:
            raise ValueError("its states never or hardly ever forget what was before")
        self._known: tuple[Draw, int, int] = (_nobody, 0, 0)

    def state_at(self, draw: Draw, seq: int) -> int:
        """Return the state at a number."""
        drawn, number, state = self._known
        if drawn is draw and number == seq - 1:
            state = self._maps[bisect_right(self._cuts, draw(_STEP, seq))][state]
        else:
            state = self._look_back(draw, seq)
        self._known = draw, seq, state
        return state

    def _look_back(self, draw: Draw, seq: int) -> int:
        """Look back to where all states meet, or to the state that is known."""
        drawn, number, known = self._known
        through: Map = tuple(range(len(self.rows)))
        while drawn is not draw or number != seq:
            step = self._maps[bisect_right(self._cuts, draw(_STEP, seq))]
            through = tuple(through[state] for state in step)
            met = {through[state] for state in self.states}
            if len(met) == 1:
                return met.pop()
            seq -= 1
        return through[known]

    def _reached(self, start: int) -> tuple[int, ...]:
        found, new = {start}, {start}
        while new:
            new = {step[state] for step in self._maps for state in new} - found
            found |= new
        return tuple(sorted(found))

    def _mean_look_back(self) -> float:
        """Draws until all states have met, on average; not in [0, inf) where they never do.

        Forwards it takes as many as backwards: sets of states shrink until one is left.
        """
        whole = frozenset(self.states)
        places, new = {whole: 0}, [whole]
        while new:
            images = {frozenset(step[state] for state in one) for one in new for step in self._maps}
            new = sorted((one for one in images - places.keys() if len(one) > 1), key=sorted)
            places |= {one: len(places) + place for place, one in enumerate(new)}
        if len(whole) == 1:
            return 0.0
        stays = np.zeros((len(places), len(places)))
        for one, place in places.items():
            for step, width in zip(self._maps, self._widths, strict=True):
                image = frozenset(step[state] for state in one)
                if len(image) > 1:
                    stays[place, places[image]] += width
        try:
            return float(np.linalg.solve(np.eye(len(places)) - stays, np.ones(len(places)))[0])
        except np.linalg.LinAlgError:
            return inf

    @cached_property
    def shares(self) -> np.ndarray:
        """Share of the messages that finds the chain in each state."""
        equations = np.vstack((self.rows.T - np.eye(len(self.rows)), np.ones(len(self.rows))))
        of_unreached = [one for one in range(len(self.rows)) if one not in self.states]
        none = np.zeros((len(of_unreached), len(self.rows)))
        none[range(len(of_unreached)), of_unreached] = 1.0
        wanted = np.zeros(len(equations) + len(none))
        wanted[len(self.rows)] = 1.0
        found = np.linalg.lstsq(np.vstack((equations, none)), wanted)[0]
        found[found < _ROUNDING] = 0.0
        return np.asarray(found / found.sum())


def _map(sums: Sequence[Sequence[float]], drawn: float) -> Map:
    """Next state of each state; a row's last possible state takes what rounding leaves over."""
    return tuple(min(bisect_right(row, drawn), _last(row)) for row in sums)


def _last(row: Sequence[float]) -> int:
    return max(place for place, one in enumerate(row) if place == 0 or one > row[place - 1])


class ChainLoss(LinkLaw):
    """Base of laws that lose by the state of a Markov chain."""

    key = "loss"
    reason = "burst"

    @cached_property
    def chain(self) -> CoupledChain:
        """The chain; raises Unfit."""
        raise NotImplementedError

    @cached_property
    def loses(self) -> tuple[float, ...]:
        """Chance of a loss in each state of the chain."""
        raise NotImplementedError

    def check(self) -> None:
        """Find chances that are missing, contradict each other, or make no stationary chain."""
        _ = self.chain

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Drop by the state at the message's number, and by a draw where that leaves a choice."""
        loss = self.loses[self.chain.state_at(draw, context.seq)]
        if loss in {0.0, 1.0}:
            return "burst" if loss else 0
        return "burst" if draw(_FATE, context.seq) < loss else 0

    @property
    def mean_loss_ratio(self) -> float:
        """Share of messages lost: that of each state, by the time spent in it."""
        return float(np.clip(self.chain.shares @ np.array(self.loses), 0.0, 1.0))

    @property
    def mean_burst_messages(self) -> float | None:
        """Mean number of messages lost in a row: those lost over those lost before one is not."""
        loses, lost = np.array(self.loses), self.mean_loss_ratio
        last = float((self.chain.shares * loses) @ self.chain.rows @ (1.0 - loses))
        if not lost:
            return None
        return lost / last if last > _ROUNDING else inf

    @property
    def states(self) -> LossStates:
        """The chain with the loss in each of its states."""
        return LossStates(self.chain.rows, self.chain.shares, np.array(self.loses))

    def losses(self, distance_m: float | None) -> Losses:  # noqa: ARG002 - not a radio
        """Loss with the dependence that the chain has, over the states that are reached."""
        reached = list(self.chain.states)
        rows, shares, loses = self.states
        within = LossStates(rows[np.ix_(reached, reached)], shares[reached], loses[reached])
        return Losses(self.mean_loss_ratio, self.mean_burst_messages, within.covariances)

    def _loss_and_burst(self) -> str:
        burst = self.mean_burst_messages
        in_a_row = "" if burst is None else f", {burst:.4g} messages in a row on average"
        return f"loss {self.mean_loss_ratio:.4g}{in_a_row}"


def forgetting(
    key: str, chances: Sequence[float], chain: Callable[[], CoupledChain]
) -> CoupledChain:
    """Build a chain, or raise Unfit at `key` if it has no stationary state that can be found."""
    try:
        return chain()
    except ValueError as error:
        value = ", ".join(f"{one:g}" for one in chances)
        raise Unfit(
            key,
            f"given {value}, {error}; allowed a chain that does within 10000 messages on average, "
            "and does not go round in a circle",
        ) from error
