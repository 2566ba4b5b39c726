import math

import numpy as np
import pytest

from tests.made.vehicles.recorded_points import oval, smooth
from vehicles.geometry.smoothing import smooth_path


def test_closed_drive_is_driven_lap_after_lap_without_a_seam() -> None:
    points = oval(1.0, 0.9)
    smoothed = smooth(points, 6.0, closed=True, laps=3)
    path, lap = smoothed.path, smoothed.lap_length
    assert lap == pytest.approx(2.0 * (30.0 + 10.0 * math.pi), abs=0.1)
    assert path.length == pytest.approx(3.0 * lap, abs=1e-6)
    assert path.yaw[-1] - path.yaw[0] == pytest.approx(6.0 * math.pi, abs=1e-3)
    for station in np.arange(0.0, lap, 3.7).tolist():
        first, third = path.at(station), path.at(station + 2.0 * lap)
        assert (first.east, first.north) == pytest.approx((third.east, third.north), abs=1e-6)
        assert first.curvature == pytest.approx(third.curvature, abs=1e-6)
    assert np.max(np.abs(np.diff(path.curvature))) < 0.012
    assert smoothed.points_used == points.shape[1]


def test_overlap_past_the_start_is_cut_and_the_miss_shared_out() -> None:
    """The drive runs 4 m over its start and misses it by 30 cm, as recorded loops do."""
    lap = 2.0 * (30.0 + 10.0 * math.pi)
    points = oval(1.0 + 4.0 / lap, 1.0)
    points[1] += 0.3 * np.arange(points.shape[1]) / (points.shape[1] - 5)
    smoothed = smooth(points, 6.0, closed=True, laps=2)
    path = smoothed.path
    assert points.shape[1] - smoothed.points_used in (4, 5)
    assert smoothed.lap_length == pytest.approx(lap, abs=0.5)
    assert smoothed.deviation_max < 0.2
    seam = (path.station > smoothed.lap_length - 8.0) & (path.station < smoothed.lap_length + 8.0)
    assert np.max(np.abs(path.curvature[seam])) < 0.02  # the start is on a straight
    assert path.yaw[-1] - path.yaw[0] == pytest.approx(4.0 * math.pi, abs=1e-3)


@pytest.mark.parametrize("spacing", [4.0, 9.0, 15.0, 22.0])
def test_a_closed_drive_of_few_points_closes_in_a_curve_without_a_seam(spacing: float) -> None:
    """As recorded at 1 Hz: no other point is near the first one."""
    angle = np.arange(0.0, 2.3 * math.pi, spacing / 70.0)
    smoothed = smooth_path(70.0 * np.sin(angle), -70.0 * np.cos(angle), 8.0, closed=True, laps=2)
    assert smoothed.lap_length == pytest.approx(140.0 * math.pi, rel=0.002)
    assert np.max(np.abs(smoothed.path.curvature)) < 1.0 / 60.0
    off = np.hypot(smoothed.path.east, smoothed.path.north) - 70.0
    assert np.max(np.abs(off)) < 0.15
