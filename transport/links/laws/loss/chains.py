"""Losses in bursts: Markov chains that step with each message, sent or never come.

The state at any number follows from the draws of the numbers up to it, which exist below zero too.
All states that the past may have left are followed through one and the same draw of each number;
looking back far enough they have all become one, and what was before does not matter (coupling from
the past: Propp and Wilson, Random Structures and Algorithms 9, 1996). So any verdict can be
computed alone, and the chain is exactly stationary from the first message on.
"""

from bisect import bisect_right
from collections.abc import Sequence
from functools import cached_property
from itertools import accumulate
from math import inf

import numpy as np

from transport.links.laws.effect import Draw

LONGEST_LOOK_BACK = 10_000.0
"""Draws that one verdict alone may cost on average: a hundredth of a second."""

ROUNDING = 1e-12
"""Chances below it are none."""

_STEP = "burst"

Map = tuple[int, ...]
"""The next state of each state, under one draw."""


def _no_draw(purpose: str, seq: int) -> float:
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
        found[found < ROUNDING] = 0.0
        return np.asarray(found / found.sum())


def _map(sums: Sequence[Sequence[float]], drawn: float) -> Map:
    """Next state of each state; a row's last possible state takes what rounding leaves over."""
    return tuple(min(bisect_right(row, drawn), _last(row)) for row in sums)


def _last(row: Sequence[float]) -> int:
    return max(place for place, one in enumerate(row) if place == 0 or one > row[place - 1])
