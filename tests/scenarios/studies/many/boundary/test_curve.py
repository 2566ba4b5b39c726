"""Searches on curves with known answers: coverage of intervals, findings, and numbers of runs."""

from collections.abc import Callable
from math import log, log1p
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from scenarios.definition.run_limits import Limit
from scenarios.studies.many.boundary import BoundaryQuery, BoundaryResult, find_boundary
from scenarios.studies.many.variant import Variant
from tests.made.many.engines import SyntheticEngine

Curve = Callable[[NDArray[np.float64] | float], Any]
"""Share of broken runs at a value."""
SHAPES: dict[str, Callable[[float], Curve]] = {
    # Boundary at 0 in units of the width, for a requested share.
    "logistic": lambda share: lambda z: 1 / (1 + np.exp(-z) * (1 - share) / share),
    "probit": lambda share: lambda z: norm.cdf(norm.ppf(share) + z / 1.7),
    "cloglog": lambda share: lambda z: 1 - np.exp(-np.exp(log(-log1p(-share)) + z)),
    "loglog": lambda share: lambda z: np.exp(log(share) * np.exp(-z)),
    "weibull": lambda share: lambda z: 1 - (1 - share) ** (np.maximum(1 + z / 4, 0) ** 4),
    "step": lambda _: lambda z: 1.0 * (z >= 0),
}
"""Known curves. The Weibull curve is 0 below four widths before its boundary."""
REQUIRED = [("logistic", width, 0.5) for width in (0.005, 0.05, 0.15)]
CASES = [
    REQUIRED[0],
    REQUIRED[2],
    *(
        (shape, width, share)
        for shape in SHAPES
        for share in (0.05, 0.5, 0.95)
        for width in (0.005, 0.05, 0.15)
        if (shape, width, share) not in REQUIRED
        and not (shape == "step" and (width > 0.005 or share != 0.5))
    ),
    REQUIRED[1],
]
LIMIT = Limit("cross_track_error_m_max", 1.0)
VARIANT = Variant(text="", name="known")


def searched(
    curve: Curve, seed: int, share: float = 0.5, *, scale: float = 1.0, **options: Any
) -> BoundaryResult:
    draws = np.random.default_rng(seed)
    engine = SyntheticEngine(
        lambda job: bool(draws.random() < curve(float(job.key.partition("/")[0]) / scale))
    )
    query = BoundaryQuery(
        variant=VARIANT, key="a.b", limit=LIMIT, high=scale, share=share, **options
    )
    return find_boundary(query, engine)


@pytest.mark.spread(2)
@pytest.mark.campaign(6, 400)
@pytest.mark.parametrize(("shape", "width", "share"), CASES)
def test_intervals_contain_the_known_boundary(
    shape: str, width: float, share: float, campaign: int
) -> None:
    contained, runs, widths = 0, list[int](), list[float]()
    relative = SHAPES[shape](share)
    for seed in range(campaign):
        truth = np.random.default_rng([seed, 7]).uniform(0.2, 0.8)

        def curve(value: Any, truth: float = truth) -> Any:
            return relative((value - truth) / width)

        result = searched(curve, seed, share)
        low = -1.0 if result.low is None else result.low
        high = 2.0 if result.high is None else result.high
        contained += result.finding == "found" and low <= truth <= high
        runs.append(result.runs)
        widths.append(0.5 * (min(high, 1.0) - max(low, 0.0)))
    print(
        f"{shape:9} width {width:<5} share {share:<4}: {100 * contained / campaign:5.1f} %, "
        f"half-width {np.mean(widths):.4f}, {np.mean(runs):.0f} runs"
    )
    if campaign < 100:
        assert contained >= campaign - 1
    else:
        assert contained >= 0.88 * campaign
        if (shape, width, share) in REQUIRED:
            assert 0.9 * campaign <= contained <= 0.98 * campaign


@pytest.mark.parametrize(
    ("ratio", "share", "finding", "most"),
    [
        (1.0, 0.5, "broken", 40), (0.0, 0.5, "held", 40), (0.0, 0.05, "held", 200),
        (0.3, 0.05, "broken", 80), (0.5, 0.95, "held", 60),
    ],
)  # fmt: skip
def test_a_range_without_a_boundary_is_found_at_once(
    ratio: float, share: float, finding: str, most: int
) -> None:
    result = searched(lambda _: ratio, 1, share)
    assert (result.finding, result.boundary, result.low, result.high) == (finding, *[None] * 3)
    assert result.runs <= most


def test_a_rise_and_fall_is_no_boundary() -> None:
    result = searched(lambda value: 0.95 * (0.3 < value < 0.7), 1)
    assert (result.finding, result.boundary) == ("misfit", None)
    assert result.runs < 200


def test_a_falling_curve_mirrors_a_rising_one() -> None:
    falling = searched(lambda value: 1 / (1 + np.exp((value - 0.6) / 0.03)), 3)
    assert falling.rises is False
    assert falling.low is not None
    assert falling.high is not None
    assert falling.low < 0.6 < falling.high


def test_a_boundary_near_the_end_has_an_open_interval() -> None:
    result = searched(lambda value: 1 / (1 + np.exp(-(value - 0.95) / 0.1)), 0, max_runs=100)
    assert (result.finding, result.high) == ("found", None)
    assert result.low is not None
    assert result.low < 0.95


def test_a_rare_share_is_not_judged_by_few_runs() -> None:
    """Twenty broken runs are expected among 400 at a share of 5 %."""
    step: Curve = lambda value: 1.0 * (value > 0.4)  # noqa: E731
    assert searched(step, 1, 0.05).runs >= 400
    assert searched(step, 1, 0.5).runs < 100
