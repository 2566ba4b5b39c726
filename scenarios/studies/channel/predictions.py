"""Burst lengths, delays and distances predicted by the laws of a link."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.expected import ExpectedChannel
from transport.links.laws.effect import Effect
from transport.links.laws.moments import LossStates
from vehicles.schedule import MILLISECOND

Floats = NDArray[np.float64]
LONGEST_BURST = 2000
"""Length of the longest burst whose share is computed, in messages."""
TOLERANCE = 1e-6
DISTANCE_COUNT = 10


def burst_shares(expected: ExpectedChannel, effects: Sequence[Effect]) -> Floats | None:
    """Share of bursts of 1, 2, 3 … messages; None without a closed form.

    Lengths are geometric for independent losses. A Markov chain combined with independent losses
    is a hidden Markov chain: a burst continues while each successive state loses its message.
    """
    loss, burst = expected.loss_ratio, expected.burst_messages
    if not loss or burst is None or not np.isfinite(burst):
        return None
    if abs(burst * (1.0 - loss) - 1.0) < TOLERANCE:
        return (1.0 - loss) * loss ** np.arange(float(LONGEST_BURST))
    for states in filter(None, (effect.states for effect in effects)):
        shares = _chain_burst_shares(states, loss)
        mean = float(shares @ np.arange(1, LONGEST_BURST + 1))
        return shares if abs(mean / burst - 1.0) < TOLERANCE else None
    return None


def _chain_burst_shares(law: LossStates, loss: float) -> Floats:
    """Burst lengths of a chain combined with independent losses to a total loss of `loss`."""
    chain_loss = float(np.clip(law.shares @ law.loss_by_state, 0.0, 1.0))
    independent_loss = 1.0 - (1.0 - loss) / (1.0 - chain_loss)
    loss_by_state = 1.0 - (1.0 - law.loss_by_state) * (1.0 - independent_loss)
    state = (law.shares * (1.0 - loss_by_state)) @ law.rows * loss_by_state
    first_loss = state.sum()
    longer = np.empty(LONGEST_BURST + 1)
    for length in range(LONGEST_BURST + 1):
        longer[length] = state.sum() / first_loss
        state = state @ law.rows * loss_by_state
    return longer[:-1] - longer[1:]


def delay_quantiles(
    expected: ExpectedChannel, effects: Sequence[Effect], shares: Sequence[float]
) -> list[float] | None:
    """Quantiles (ms) of the delay at `shares`; None with several random laws."""
    mean = expected.latency_ms_mean
    random = [
        (effect, effect.delays) for effect in effects if effect.delays and effect.delays.variance
    ]
    if mean is None or len(random) > 1:
        return None
    if not random:
        return [mean for _ in shares]
    law, delays = random[0]
    quantiles = [law.delay_quantile(share) for share in shares]
    constant = mean - delays.mean / MILLISECOND
    known = [constant + delay / MILLISECOND for delay in quantiles if delay is not None]
    return known if len(known) == len(quantiles) else None


def distances_m(effects: Sequence[Effect]) -> list[float]:
    """Ten distances over the range of a link's radio; empty without a radio."""
    for range_m in filter(None, (effect.range_m for effect in effects)):
        return [range_m * (index + 0.5) / DISTANCE_COUNT for index in range(DISTANCE_COUNT)]
    return []
