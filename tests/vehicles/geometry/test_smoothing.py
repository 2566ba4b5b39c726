import math

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.made.vehicles.recorded_points import Points, circle, noisy, smooth
from vehicles.geometry.sampled_path import SAMPLING, SampledPath
from vehicles.geometry.smoothing import SmoothedPath, smooth_path


def interior(smoothed: SmoothedPath, margin: float) -> NDArray[np.bool_]:
    station = smoothed.path.station
    inside: NDArray[np.bool_] = (station > margin) & (station < station[-1] - margin)
    return inside


def drift(path: SampledPath) -> tuple[float, float]:
    """Errors of yaw (rad) and position (m) after integrating the curvature."""
    lengths = np.diff(path.station)
    turned = np.cumsum(0.5 * (path.curvature[1:] + path.curvature[:-1]) * lengths)
    yaw = path.yaw[0] + np.concatenate(([0.0], turned))
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    east = path.east[0] + np.cumsum(lengths * np.cos(middle))
    north = path.north[0] + np.cumsum(lengths * np.sin(middle))
    apart = np.hypot(east - path.east[1:], north - path.north[1:])
    return float(np.max(np.abs(yaw - path.yaw))), float(np.max(apart))


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_tight_turn_keeps_its_position_and_curvature(mirrored: bool) -> None:
    x, y = circle(8.0, 40.0, 1.0)
    smoothed = smooth_path(x, -y if mirrored else y, 4.5)
    sign = -1.0 if mirrored else 1.0
    inside = interior(smoothed, 9.0)
    path = smoothed.path
    assert sign * 8.0 * path.curvature[inside] == pytest.approx(1.0, abs=0.005)
    off = np.hypot(path.east, path.north - sign * 8.0) - 8.0
    assert np.max(np.abs(off[inside])) < 0.001
    assert smoothed.deviation_max < 0.005  # including the ends
    assert path.length == pytest.approx(39.0, abs=0.02)


@pytest.mark.parametrize("spacing", [0.5, 1.5])
def test_noise_on_a_motorway_bend_is_reduced_as_stated(spacing: float) -> None:
    bends, yaws, errors = [], [], []
    for seed in range(6):
        points = noisy(circle(300.0, 400.0, spacing, yaw=2.0), seed=seed)
        smoothed = smooth(points, 20.0)
        path, inside = smoothed.path, interior(smoothed, 25.0)
        bends.append(path.curvature[inside] - 1.0 / 300.0)
        centre = (-300.0 * math.sin(2.0), 300.0 * math.cos(2.0))
        east, north = path.east - centre[0], path.north - centre[1]
        errors.append((np.hypot(east, north) - 300.0)[inside])
        tangent = np.arctan2(north, east) + math.pi / 2.0
        yaws.append(np.angle(np.exp(1j * (path.yaw - tangent)))[inside])
    stated = 0.02 * 20.0 * spacing**0.5 / 20.0**2.5
    assert np.std(np.concatenate(bends)) == pytest.approx(stated, rel=0.3)
    assert abs(np.mean(np.concatenate(bends))) < stated / 4.0
    assert np.std(np.concatenate(errors)) < 0.006 * spacing**0.5
    assert np.std(np.concatenate(yaws)) < 0.001 * spacing**0.5


@pytest.mark.parametrize(
    ("points", "reach"),
    [(noisy(circle(8.0, 100.0, 1.0)), 6.0), (noisy(circle(300.0, 500.0, 1.0)), 20.0)],
)
def test_curvature_heading_and_position_agree(points: Points, reach: float) -> None:
    turned, moved = drift(smooth(points, reach).path)
    assert turned < 0.001
    assert moved < 0.01


def test_uneven_points_give_the_same_path() -> None:
    random = np.random.default_rng(8)
    along = np.sort(random.uniform(0.0, 80.0, 160))
    angle = along / 15.0
    smoothed = smooth_path(15.0 * np.sin(angle), 15.0 * (1.0 - np.cos(angle)), 6.0)
    inside = interior(smoothed, 10.0)
    assert smoothed.path.curvature[inside] == pytest.approx(1.0 / 15.0, abs=0.002)
    assert smoothed.deviation_max < 0.02


@pytest.mark.parametrize("radius", [12.0, -12.0])
def test_lead_in_is_a_straight_that_bends_gradually_into_the_drive(radius: float) -> None:
    points = circle(abs(radius), 60.0, 1.0, yaw=1.0 if radius > 0 else -1.0)
    if radius < 0.0:
        points[1] *= -1.0
    smoothed = smooth(points, 6.0, lead_in=40.0)
    path = smoothed.path
    assert smoothed.start == pytest.approx(40.0, abs=0.05)
    assert smoothed.stations[0] == pytest.approx(40.0, abs=0.05)
    before = path.station < 33.0
    assert path.curvature[before] == pytest.approx(0.0, abs=1e-6)
    assert path.yaw[before] == pytest.approx(1.0, abs=0.01)
    assert (path.east[0], path.north[0]) == pytest.approx(
        (-40.0 * math.cos(1.0), -40.0 * math.sin(1.0)), abs=0.4
    )
    assert np.max(np.abs(np.diff(path.curvature))) < 0.01  # the step it bridges is 0.083
    assert path.at(55.0).curvature == pytest.approx(1.0 / radius, rel=0.01)


def test_points_without_a_path_are_rejected_in_one_line() -> None:
    x, y = circle(50.0, 40.0, 1.0)
    for arguments, message in [
        ((x[:5], y[:5], 5.0), "at least 8 points"),
        ((np.zeros(100), np.zeros(100), 5.0), "at least 8 points"),
        (([], [], 5.0), "at least 8 points"),
        ((np.where(x > 20.0, np.nan, x), y, 5.0), "finite"),
    ]:
        with pytest.raises(ValueError, match=message) as refusal:
            smooth_path(*arguments)
        assert "\n" not in str(refusal.value)
    with pytest.raises(ValueError, match="does not close: it ends 38"):
        smooth_path(x, y, 5.0, closed=True)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -math.pi / 2, 0.7])
def test_straight_stays_straight_in_every_heading(yaw: float) -> None:
    along = np.cumsum(np.random.default_rng(2).uniform(0.3, 2.0, 60))
    smoothed = smooth_path(along * math.cos(yaw), along * math.sin(yaw), 8.0)
    path = smoothed.path
    assert path.length == pytest.approx(along[-1] - along[0], abs=1e-9)
    assert path.yaw == pytest.approx(np.full(path.yaw.shape, yaw), abs=1e-9)
    assert path.curvature == pytest.approx(np.zeros(path.yaw.shape), abs=1e-8)
    assert smoothed.deviation_max < 1e-9
    assert smoothed.stations == pytest.approx(along - along[0], abs=1e-9)
    assert np.max(np.diff(path.station)) <= SAMPLING + 1e-9
