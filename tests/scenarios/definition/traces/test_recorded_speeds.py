"""Recorded speeds that are used, mended, or ignored."""

import numpy as np
import pytest

from scenarios.definition.traces.drive import Floats
from scenarios.definition.traces.recorded_speeds import usable_speeds

TIMES = 0.1 * np.arange(600.0)
SPEEDS = 15.0 + 5.0 * np.sin(0.2 * TIMES)
STATIONS = 15.0 * TIMES + 25.0 * (1.0 - np.cos(0.2 * TIMES))
POINTS = np.stack((800.0 * np.sin(STATIONS / 800.0), 800.0 * (1.0 - np.cos(STATIONS / 800.0))))


def changed(places: slice | list[int], value: float) -> Floats:
    speeds = SPEEDS.copy()
    speeds[places] = value
    return speeds


@pytest.mark.parametrize("value", [1e6, 120.0, 0.0, np.inf])
@pytest.mark.parametrize("places", [[200], [0, 599], list(range(100, 120))])
def test_single_absurd_speeds_are_interpolated(value: float, places: list[int]) -> None:
    speeds, remarks = usable_speeds(changed(places, value), TIMES, POINTS)
    assert speeds is not None
    assert np.max(np.abs(speeds - SPEEDS)) < (2.5 if np.isinf(value) else 0.6)
    others = np.delete(np.arange(600), places)
    assert np.array_equal(speeds[others], SPEEDS[others])
    if np.isfinite(value):
        assert remarks[0].startswith(str(len(places)))


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (3.6, "3.60 times what the positions need (km/h?)"),
        (1.94384, "1.94 times what the positions need (knots?)"),
        (2.23694, "2.24 times what the positions need (mph?)"),
        (0.5, "0.50 times what the positions need:"),
        (1000.0, "1000."),
    ],
)
def test_speeds_in_another_unit_are_ignored(factor: float, words: str) -> None:
    speeds, (remark,) = usable_speeds(factor * SPEEDS, TIMES, POINTS)
    assert speeds is None
    assert words in remark


def test_a_standstill_and_a_pause_fit() -> None:
    times = TIMES + np.where(TIMES > 30.0, 600.0, 0.0)
    speeds, remarks = usable_speeds(SPEEDS, times, POINTS)
    assert speeds is not None
    assert remarks == ()
    speeds, remarks = usable_speeds(0.02 * np.ones(600), TIMES, 1e-3 * POINTS)
    assert speeds is not None
    assert remarks == ()
