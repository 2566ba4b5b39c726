"""Splitting is unbiased for processes of known probability, including ties and jumps."""

from dataclasses import dataclass
from math import inf, sqrt
from statistics import fmean, stdev

import numpy as np
import pytest

from scenarios.studies.many.splitting import split


@dataclass(frozen=True)
class Walk:
    """Successive states of a Markov chain; `top` breaks the limit."""

    states: tuple[int, ...]
    top: int

    @property
    def severity(self) -> float:
        highest = max(self.states)
        return inf if highest >= self.top else float(highest)


@dataclass(frozen=True)
class Chain:
    """A chain that goes up by one with the probability `up`, or down as defined by `falls`.

    "to zero" is a series of losses, "by one" the gambler's ruin.
    """

    up: float
    steps: int
    top: int
    falls: str = "to zero"

    def after(self, state: int) -> int:
        return 0 if self.falls == "to zero" else max(state - 1, 0)

    def probability(self) -> float:
        """Exact probability of reaching `top` within `steps`."""
        law = np.zeros(self.top + 1)
        law[0] = 1.0
        for _ in range(self.steps):
            following = np.zeros_like(law)
            following[self.top] = law[self.top]
            for state in range(self.top):
                following[state + 1] += self.up * law[state]
                following[self.after(state)] += (1.0 - self.up) * law[state]
            law = following
        return float(law[self.top])

    def walk(self, seed: int, before: tuple[int, ...] = (0,)) -> Walk:
        draws = np.random.Generator(np.random.PCG64(seed)).random(self.steps).tolist()
        states = list(before)
        while len(states) <= self.steps and states[-1] < self.top:
            up = draws[len(states) - 1] < self.up
            states.append(states[-1] + 1 if up else self.after(states[-1]))
        return Walk(tuple(states), self.top)

    def continue_path(self, parent: Walk, level: float, seed: int) -> Walk:
        crossed = next(at for at, state in enumerate(parent.states) if state > level)
        return self.walk(seed, parent.states[: crossed + 1])


CHAINS = {
    "1e-3, a run of losses": Chain(up=0.2, steps=60, top=7),
    "1e-3, up and down": Chain(up=0.3, steps=40, top=10, falls="by one"),
    "1e-6, a run of losses": Chain(up=0.2, steps=60, top=11),
}


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.campaign(40, 1000)
def test_the_mean_is_the_probability(name: str, campaign: int) -> None:
    chain = CHAINS[name]
    truth = chain.probability()
    assert 0.3 < truth / float(name.split(",", maxsplit=1)[0]) < 3.0
    estimates = [
        split(
            20, chain.walk, chain.continue_path, np.random.Generator(np.random.PCG64([7, number]))
        ).estimate
        for number in range(campaign)
    ]
    error = stdev(estimates) / sqrt(len(estimates))
    assert abs(fmean(estimates) - truth) < 3.0 * error
    assert error < 0.25 * truth
