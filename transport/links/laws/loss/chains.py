"""Markov chains that step with each message number, whether or not the message arrives.

The state at a number follows from the keyed draws of the numbers up to it, negative ones included.
All possible earlier states are followed through the same draws, far enough back that they have
become one state (coupling from the past: Propp and Wilson, Random Structures and Algorithms 9,
1996). Each verdict can therefore be computed alone, and the chain is stationary from the start.
"""

from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate
from math import inf

import numpy as np

from transport.links.laws.effect import Draw

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
