"""What the laws of a link say of bursts, delays and distances, to hold a sample against."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.expected import ExpectedChannel
from scenarios.definition.channel.reach import RADIO, farthest_m
from transport.links.laws.chains import FourState, GilbertElliott
from transport.links.laws.content import Reordering
from transport.links.laws.delay import DrawnDelay
from transport.links.laws.effect import Effect
from transport.links.laws.normals import quantile
from transport.links.laws.plain import Jitter
from vehicles.schedule import MILLISECOND

Floats = NDArray[np.float64]
LONGEST = 2000
"""Bursts that are told apart, in messages."""
SAME = 1e-6
DISTANCES = 10


def burst_shares(expected: ExpectedChannel, effects: Sequence[Effect]) -> Floats | None:
    """Share of the bursts with 1, 2, 3 … messages; None where no closed form is known here.

    It is geometric for independent losses. A chain that loses by its state, with independent losses
    beside it, is a hidden chain: a burst goes on while each of its states in turn loses.
    """
    loss, burst = expected.loss_ratio, expected.burst_messages
    if not loss or burst is None or not np.isfinite(burst):
        return None
    if abs(burst * (1.0 - loss) - 1.0) < SAME:
        return (1.0 - loss) * loss ** np.arange(float(LONGEST))
    for effect in effects:
        if isinstance(effect, GilbertElliott | FourState):
            shares = _of_chain(effect, loss)
            mean = float(shares @ np.arange(1, LONGEST + 1))
            return shares if abs(mean / burst - 1.0) < SAME else None
    return None


def _of_chain(law: GilbertElliott | FourState, loss: float) -> Floats:
    """The same of a chain beside independent losses that make the whole `loss`."""
    beside = 1.0 - (1.0 - loss) / (1.0 - law.mean_loss_ratio)
    loses = 1.0 - (1.0 - np.array(law.loses)) * (1.0 - beside)
    state = (law.chain.shares * (1.0 - loses)) @ law.chain.rows * loses
    begun = state.sum()
    longer = np.empty(LONGEST + 1)
    for length in range(LONGEST + 1):
        longer[length] = state.sum() / begun
        state = state @ law.chain.rows * loses
    return longer[:-1] - longer[1:]


def delay_quantiles(
    expected: ExpectedChannel, effects: Sequence[Effect], shares: Sequence[float]
) -> list[float] | None:
    """Delays (ms) that such shares of the messages do not exceed; None with several laws."""
    random = [one for one in effects if isinstance(one, Jitter | DrawnDelay | Reordering)]
    if expected.latency_ms_mean is None or len(random) > 1:
        return None
    if not random:
        return [expected.latency_ms_mean for _ in shares]
    law = random[0]
    if isinstance(law, Jitter):
        least = expected.latency_ms_mean - 0.5 * law.spread / MILLISECOND
        return [least + share * law.spread / MILLISECOND for share in shares]
    if isinstance(law, DrawnDelay):
        least = expected.latency_ms_mean - law.law.mean_ns / MILLISECOND
        return [least + law.law.at(quantile(share)) / MILLISECOND for share in shares]
    return None


def distances_m(effects: Sequence[Effect]) -> list[float]:
    """Ten distances over the reach of a link's radio; none without one."""
    for effect in effects:
        if isinstance(effect, RADIO):
            far = farthest_m(effect)
            return [far * (place + 0.5) / DISTANCES for place in range(DISTANCES)]
    return []
