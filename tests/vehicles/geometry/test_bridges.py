"""Holes in recorded points: detection, bridging, and deviations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.recorded_points import Points, circle, noisy, smooth
from vehicles.geometry.bridges import (
    fill_holes,
    find_holes,
    noise_deviation,
    step_lengths,
)


def without(points: Points, begin: int, count: int) -> Points:
    return np.delete(points, np.arange(begin, begin + count), axis=1)


@pytest.mark.parametrize("spacing", [0.3, 1.0, 3.0, 12.0])
@pytest.mark.parametrize("size", [0.0, 0.02, 0.5, 2.5])
def test_noise_is_estimated_on_arcs_with_any_spacing(spacing: float, size: float) -> None:
    result = noise_deviation(noisy(circle(100.0, 1500.0 * spacing, spacing, yaw=1.0), size))
    assert result == pytest.approx(size, rel=0.15, abs=0.01 * spacing)


def test_a_hole_is_long_and_unusual() -> None:
    steps = np.full(60, 1.0)
    steps[[10, 20, 30]] = 4.9, 5.1, 50.0
    assert find_holes(steps).tolist() == [20, 30]
    assert find_holes(np.full(60, 30.0)).tolist() == []  # a receiver at 1 Hz on a motorway
    speeding = np.concatenate((np.full(30, 2.0), np.full(30, 9.0)))
    assert find_holes(speeding).tolist() == []


@examples(10, 60)
@given(
    radius=st.sampled_from([20.0, 40.0, 100.0, 400.0, 1e6]),
    length=st.floats(6.0, 50.0),
    spacing=st.floats(0.3, 1.2),
    yaw=st.floats(-3.1, 3.1),
    left=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_an_arc_is_bridged_by_an_arc(  # noqa: PLR0917 - what is drawn
    radius: float, length: float, spacing: float, yaw: float, left: bool, seed: int
) -> None:
    length = min(length, 1.6 * radius)
    exact = circle(radius, 100.0 + length, spacing, yaw=yaw)
    begin, count = round(50.0 / spacing), math.ceil(length / spacing)
    centre = np.array([-math.sin(yaw), math.cos(yaw)])[:, None] * radius
    if not left:
        exact[1], centre[1] = -exact[1], -centre[1]
    points = without(noisy(exact, seed=seed), begin, count)
    filled, indices, holes = fill_holes(points, 8.0)
    assert holes == (begin - 1,)
    assert np.array_equal(filled[:, indices], points)
    bridge = np.delete(filled, indices, axis=1)
    off = np.hypot(*(bridge - centre)) - radius
    # The error comes from the noise of both headings and grows over the hole.
    assert np.max(np.abs(off)) < 0.05 + 0.004 * length
    # No overshoot: each step goes forwards, and turns no more than the arc and noise.
    steps = np.diff(filled[:, begin - 1 : begin + bridge.shape[1] + 1])
    course = np.unwrap(np.arctan2(steps[1], steps[0]))[1:-1]
    assert np.all(np.abs(np.diff(course)) < 3.0 * step_lengths(bridge)[1:].max() / radius + 0.05)


@pytest.mark.parametrize("length", [10, 20, 30, 50])
def test_a_path_over_a_hole_is_the_arc(length: int) -> None:
    worst, stated = 0.0, 0.0
    for seed in range(8):
        points = without(noisy(circle(60.0, 180.0, 0.5), seed=seed), 150, 2 * length)
        smoothed = smooth(points, 8.0)
        inside = (smoothed.path.station > 10.0) & (smoothed.path.station < 170.0)
        off = np.hypot(smoothed.path.east, smoothed.path.north - 60.0) - 60.0
        worst = max(worst, float(np.max(np.abs(off[inside]))))
        stated = max(stated, smoothed.deviation_max)
        (hole,) = smoothed.holes
        assert hole.point == 149
        assert hole.length == pytest.approx(length, abs=1.0 + length**3 / 24.0 / 60.0**2)
    assert worst < 0.12
    assert stated < 0.1
