"""Comparison of a link's laws with a sample: loss, bursts, delay, delivery over distance."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.build import ExpectedChannel, expected_channel
from scenarios.definition.check.link_forecast import SampledChannel, StraightDrive
from scenarios.results.links import CONFIDENCE, bursts, inflation, mean_length, share
from transport.links.laws.link_law import Effect, LossStates
from vehicles.schedule import MILLISECOND

# ---- Burst lengths, delays and distances predicted by the laws of a link


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


# ---- Comparison


QUANTILES = (0.05, 0.5, 0.95, 0.99)
BURST_EDGES = (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 50)
"""First length of each bin of burst lengths; the last bin is open."""


@dataclass(frozen=True, slots=True)
class ComparedFigure:
    """One figure: predicted by the law (None if unknown) and sampled, with its 95 % interval."""

    figure: str
    law: float | None
    sample: float | None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """All figures of a link; ratios are from 0 to 1, delays in ms.

    `bursts` holds the share of bursts of each length, such as "5 to 6". `distances` holds the
    delivery ratio at each distance; it is empty without a radio.
    """

    sender: str
    receiver: str
    messages: int
    rate_hz: float
    distance_m: float
    speed_mps: float
    vehicles_between: int
    figures: tuple[ComparedFigure, ...]
    bursts: tuple[ComparedFigure, ...]
    distances: tuple[ComparedFigure, ...]
    dropped: dict[str, int]


def compare(drive: StraightDrive, messages: int) -> tuple[Comparison, SampledChannel]:
    """Sample `messages` of a link, and a tenth of that at each distance; compare with the laws."""
    sample, effects = drive.sample(messages), drive.effects()
    between = drive.between()
    expected = expected_channel(drive.table, drive.rate_hz, drive.distance_m, drive.between)
    if drive.scenario.link_setting(*drive.link, 0).off:
        expected = replace(expected, loss_ratio=None, burst_messages=None)
    lengths = bursts(sample.lost)
    loss = _share_figure("loss", expected.loss_ratio, sample.lost, expected.loss_inflation)
    burst = mean_length(lengths, CONFIDENCE)
    interval = (burst.value, burst.low, burst.high) if burst and isfinite(burst.high) else (None,)
    delays = sample.delay_ms
    delivered = bool(len(delays))
    quantiles: Sequence[float | None] = delay_quantiles(expected, effects, QUANTILES) or [
        None for _ in QUANTILES
    ]
    return Comparison(
        sender=drive.link[0],
        receiver=drive.link[1],
        messages=messages,
        rate_hz=drive.rate_hz,
        distance_m=drive.distance_m,
        speed_mps=drive.speed_mps,
        vehicles_between=between.count,
        figures=(
            loss,
            ComparedFigure("lost in a row", expected.burst_messages, *interval),
            ComparedFigure(
                "mean delay", expected.latency_ms_mean, float(delays.mean()) if delivered else None
            ),
            ComparedFigure(
                "delay deviation",
                expected.latency_ms_deviation,
                float(delays.std()) if delivered else None,
            ),
            *(
                ComparedFigure(
                    f"{100.0 * level:g} % delay quantile",
                    law,
                    float(np.quantile(delays, level)) if delivered else None,
                )
                for level, law in zip(QUANTILES, quantiles, strict=True)
            ),
        ),
        bursts=_burst_figures(lengths, burst_shares(expected, effects)),
        distances=tuple(
            _delivery_at(replace(drive, distance_m=metres), max(messages // 10, 100))
            for metres in distances_m(effects)
        ),
        dropped=dict(sorted(sample.dropped.items())),
    ), sample


def _share_figure(
    figure: str, law: float | None, events: NDArray[np.bool_], variance_ratio: float
) -> ComparedFigure:
    """Compare a share of events; its interval accounts for bursts of the law and of the sample."""
    lengths = bursts(events)
    mean = float(np.mean(events)) if len(events) else 0.0
    sampled = inflation(mean, float(lengths.mean())) if len(lengths) else 1.0
    interval = share(int(events.sum()), len(events), CONFIDENCE, max(sampled, variance_ratio))
    return ComparedFigure(figure, law, interval.value, interval.low, interval.high)


def _burst_figures(
    lengths: NDArray[np.int_], law: NDArray[np.float64] | None
) -> tuple[ComparedFigure, ...]:
    rows = []
    for edge, after in zip(BURST_EDGES, (*BURST_EDGES[1:], None), strict=True):
        within = (lengths >= edge) & (lengths < (after or lengths.max(initial=0) + 1))
        expected = None if law is None else float(law[edge - 1 : after and after - 1].sum())
        interval = share(int(within.sum()), len(lengths), CONFIDENCE)
        name = f"{edge} or more" if after is None else f"{edge} to {after - 1}"
        name = f"{edge}" if after == edge + 1 else name
        rows.append(ComparedFigure(name, expected, interval.value, interval.low, interval.high))
    while rows and not rows[-1].sample and (rows[-1].law or 0.0) < 1e-4:
        rows.pop()
    return tuple(rows) if len(lengths) else ()


def _delivery_at(drive: StraightDrive, messages: int) -> ComparedFigure:
    expected = expected_channel(drive.table, drive.rate_hz, drive.distance_m, drive.between)
    law = None if expected.loss_ratio is None else 1.0 - expected.loss_ratio
    received = ~drive.sample(messages).lost
    return _share_figure(f"{drive.distance_m:.0f} m", law, received, expected.loss_inflation)
