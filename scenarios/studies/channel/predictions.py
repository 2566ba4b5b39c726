"""Bursts, delays and distances by the laws of a link, to compare a sample with."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.expected import ExpectedChannel
from transport.links.laws.effect import Effect
from transport.links.laws.moments import LossStates
from vehicles.schedule import MILLISECOND

Floats = NDArray[np.float64]
LONGEST_BURST = 2000
"""Messages of the longest burst that is counted by its length."""
TOLERANCE = 1e-6
DISTANCE_COUNT = 10


def burst_shares(expected: ExpectedChannel, effects: Sequence[Effect]) -> Floats | None:
    """Share of the bursts with 1, 2, 3 … messages; None where no closed form is known here.

    It is geometric for independent losses. A chain that loses by its state, with independent losses
    beside it, is a hidden chain: a burst goes on while each of its states in turn loses.
    """
    loss, burst = expected.loss_ratio, expected.burst_messages
    if not loss or burst is None or not np.isfinite(burst):
        return None
    if abs(burst * (1.0 - loss) - 1.0) < TOLERANCE:
        return (1.0 - loss) * loss ** np.arange(float(LONGEST_BURST))
    for states in filter(None, (one.states for one in effects)):
        shares = _chain_burst_shares(states, loss)
        mean = float(shares @ np.arange(1, LONGEST_BURST + 1))
        return shares if abs(mean / burst - 1.0) < TOLERANCE else None
    return None


def _chain_burst_shares(law: LossStates, loss: float) -> Floats:
    """The same of a chain beside independent losses that make the whole `loss`."""
    own = float(np.clip(law.shares @ law.loss_by_state, 0.0, 1.0))
    beside = 1.0 - (1.0 - loss) / (1.0 - own)
    loss_by_state = 1.0 - (1.0 - law.loss_by_state) * (1.0 - beside)
    state = (law.shares * (1.0 - loss_by_state)) @ law.rows * loss_by_state
    begun = state.sum()
    longer = np.empty(LONGEST_BURST + 1)
    for length in range(LONGEST_BURST + 1):
        longer[length] = state.sum() / begun
        state = state @ law.rows * loss_by_state
    return longer[:-1] - longer[1:]


def delay_quantiles(
    expected: ExpectedChannel, effects: Sequence[Effect], shares: Sequence[float]
) -> list[float] | None:
    """Delays (ms) that such shares of the messages do not exceed; None with several laws."""
    mean = expected.latency_ms_mean
    random = [(one, one.delays) for one in effects if one.delays and one.delays.variance]
    if mean is None or len(random) > 1:
        return None
    if not random:
        return [mean for _ in shares]
    law, delays = random[0]
    found = [law.delay_quantile(share) for share in shares]
    least = mean - delays.mean / MILLISECOND
    known = [least + one / MILLISECOND for one in found if one is not None]
    return known if len(known) == len(found) else None


def distances_m(effects: Sequence[Effect]) -> list[float]:
    """Ten distances over the reach of a link's radio; none without one."""
    for far in filter(None, (one.range_m for one in effects)):
        return [far * (place + 0.5) / DISTANCE_COUNT for place in range(DISTANCE_COUNT)]
    return []
