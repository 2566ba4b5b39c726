import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from vehicles.geometry.smoothing import NEIGHBOURS, local_cubic


@given(
    seed=st.integers(0, 1000),
    count=st.integers(NEIGHBOURS, 60),
    reach=st.floats(0.5, 30.0),
    cubic=st.tuples(*[st.floats(-1.0, 1.0)] * 4),
)
@examples(10, 60)
def test_cubics_are_reproduced_up_to_the_ends_with_any_spacing(
    seed: int, count: int, reach: float, cubic: tuple[float, ...]
) -> None:
    t = np.cumsum(np.random.default_rng(seed).uniform(0.2, 2.0, count))
    at = np.linspace(t[0], t[-1], 50)
    values = np.stack([np.polyval(cubic, t / 10.0), t])
    smoothed = local_cubic(t, values, at, reach)
    assert smoothed[0] == pytest.approx(np.polyval(cubic, at / 10.0), abs=1e-6)
    assert smoothed[1] == pytest.approx(at, abs=1e-6)


def test_it_is_the_weighted_least_squares_cubic() -> None:
    random = np.random.default_rng(4)
    t = np.cumsum(random.uniform(0.5, 1.5, 80))
    values = random.normal(size=(2, 80))
    at = np.linspace(25.0, 45.0, 21)
    smoothed = local_cubic(t, values, at, 8.0)
    for k, place in enumerate(at):
        u = (t - place) / 8.0
        root = np.sqrt(np.maximum(0.0, 1.0 - u * u) ** 3)
        for row in range(2):
            expected = np.polyfit(u, values[row], 3, w=root)[-1]
            assert smoothed[row, k] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("radius", "reach"), [(8.0, 4.0), (8.0, 8.0), (300.0, 60.0)])
def test_circle_moves_inwards_as_stated(radius: float, reach: float) -> None:
    angle = np.arange(0.0, 8.0 * reach, reach / 40.0) / radius
    points = radius * np.stack([np.cos(angle), np.sin(angle)])
    middle = angle[angle.size // 2]
    at = np.array([middle, middle + 0.01]) * radius
    x, y = local_cubic(angle * radius, points, at, reach)[:, 0]
    assert radius - math.hypot(x, y) == pytest.approx(0.0009 * reach**4 / radius**3, rel=0.1)


CLUSTERS = {
    "at the beginning": [0.3] * 12 + [12.0] * 20,
    "at the end": [12.0] * 20 + [0.3] * 12,
    "between": [10.0] * 10 + [0.3] * 9 + [10.0] * 10,
    "at a stop": [10.0, 10.0, *range(10, 0, -2), 0.7, 0.3, 0.3, 0.7, *range(2, 11, 2), 10.0, 10.0],
}


@pytest.mark.parametrize("steps", CLUSTERS.values(), ids=CLUSTERS)
def test_between_a_cluster_and_sparse_points_nothing_is_extrapolated(steps: list[float]) -> None:
    """As where a car recorded at 2 Hz starts or stops."""
    t = np.cumsum([0.0, *steps])
    at = np.arange(0.0, t[-1], 0.25)
    sharpest = 0.0
    for seed in range(20):
        lateral = np.random.default_rng(seed).normal(0.0, 0.015, t.size)
        bend = np.diff(local_cubic(t, lateral[None], at, 8.0)[0], n=2) / 0.25**2
        sharpest = max(sharpest, float(np.max(np.abs(bend))))
    assert sharpest < 1.0 / 60.0  # 1/m
