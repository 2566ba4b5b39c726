"""Comparison of a link's laws with a sample: loss, bursts, delay, delivery over distance."""

from dataclasses import dataclass, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.build import expected_channel
from scenarios.definition.check.link_forecast import SampledChannel, StraightDrive
from scenarios.results.links import CONFIDENCE, bursts, inflation, mean_length, share

# ---- Comparison


QUANTILES = (0.05, 0.5, 0.95, 0.99)
DISTANCE_COUNT = 10
OUT_OF_RANGE_LOSS, STEP_M, FARTHEST_M = 0.99, 50.0, 20_000.0
"""Loss from which a radio is out of range, and the steps and end of the search for it (m)."""
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

    `bursts` holds the sampled share of bursts of each length, such as "5 to 6". `distances` holds
    the delivery ratio at each distance; it is empty without a radio.
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
    sample = drive.sample(messages)
    between = drive.between()
    expected = expected_channel(drive.table, drive.rate_hz, drive.distance_m, drive.between)
    if drive.scenario.link_setting(*drive.link, 0).off:
        expected = replace(expected, loss_ratio=None, burst_messages=None)
    lengths = bursts(sample.lost)
    loss = _share_figure("loss", expected.loss_ratio, sample.lost)
    burst = mean_length(lengths, CONFIDENCE)
    interval = (burst.value, burst.low, burst.high) if burst and isfinite(burst.high) else (None,)
    delays = sample.delay_ms
    delivered = bool(len(delays))
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
                    None,
                    float(np.quantile(delays, level)) if delivered else None,
                )
                for level in QUANTILES
            ),
        ),
        bursts=_burst_figures(lengths),
        distances=tuple(
            _delivery_at(replace(drive, distance_m=metres), max(messages // 10, 100))
            for metres in _distances_m(drive)
        ),
        dropped=dict(sorted(sample.dropped.items())),
    ), sample


def _share_figure(figure: str, law: float | None, events: NDArray[np.bool_]) -> ComparedFigure:
    """Compare a share of events; its interval accounts for their bursts."""
    lengths = bursts(events)
    mean = float(np.mean(events)) if len(events) else 0.0
    spread_by = inflation(mean, float(lengths.mean())) if len(lengths) else 1.0
    interval = share(int(events.sum()), len(events), CONFIDENCE, spread_by)
    return ComparedFigure(figure, law, interval.value, interval.low, interval.high)


def _burst_figures(lengths: NDArray[np.int_]) -> tuple[ComparedFigure, ...]:
    rows = []
    for edge, after in zip(BURST_EDGES, (*BURST_EDGES[1:], None), strict=True):
        within = (lengths >= edge) & (lengths < (after or lengths.max(initial=0) + 1))
        interval = share(int(within.sum()), len(lengths), CONFIDENCE)
        name = f"{edge} or more" if after is None else f"{edge} to {after - 1}"
        name = f"{edge}" if after == edge + 1 else name
        rows.append(ComparedFigure(name, None, interval.value, interval.low, interval.high))
    while rows and not rows[-1].sample:
        rows.pop()
    return tuple(rows) if len(lengths) else ()


def _distances_m(drive: StraightDrive) -> list[float]:
    """Ten distances over the range of a link's radio; empty without a radio."""
    if drive.table.radio is None:
        return []
    range_m = STEP_M
    while range_m < FARTHEST_M and (_loss(drive, range_m) or 0.0) < OUT_OF_RANGE_LOSS:
        range_m += STEP_M
    return [range_m * (index + 0.5) / DISTANCE_COUNT for index in range(DISTANCE_COUNT)]


def _loss(drive: StraightDrive, distance_m: float) -> float | None:
    return expected_channel(drive.table, drive.rate_hz, distance_m, drive.between).loss_ratio


def _delivery_at(drive: StraightDrive, messages: int) -> ComparedFigure:
    loss = _loss(drive, drive.distance_m)
    law = None if loss is None else 1.0 - loss
    return _share_figure(f"{drive.distance_m:.0f} m", law, ~drive.sample(messages).lost)
