"""Silences of a record: stops that a recording paused at speed does not have."""

import numpy as np
import pytest

from scenarios.definition.road.lead_speed import SILENT_ACCELERATION, SILENT_BRAKING, recorded

SPEED, STOP = 15.0, 300.0


def paused(lasts: float) -> tuple[list[float], list[float]]:
    """Times and stations of a drive at SPEED whose recording pauses at STOP m for `lasts` s."""
    stations = np.arange(0.0, 600.0, 3.0)
    times = stations / SPEED + np.where(stations > STOP, lasts, 0.0)
    return times.tolist(), stations.tolist()


def test_the_lead_brakes_to_a_pause_at_speed_and_accelerates_after_it() -> None:
    profile, _ = recorded(*paused(120.0), ())
    at = np.arange(0.0, profile.times[-1], 0.2)
    speeds = np.array([profile.at(t)[0] for t in at.tolist()])
    changes = np.diff(speeds) / 0.2
    assert -1.4 * SILENT_BRAKING < changes.min() < -0.9 * SILENT_BRAKING
    assert 0.9 * SILENT_ACCELERATION < changes.max() < 1.4 * SILENT_ACCELERATION
    assert profile.at(80.0)[0] == pytest.approx(0.0, abs=0.05)
    # It is on time before it brakes and after it has accelerated.
    for t, s in ((10.0, 150.0), (120.0 + 35.0, 525.0)):
        assert profile.distance(t) == pytest.approx(s, abs=2.0)
    assert profile.distance(80.0) == pytest.approx(STOP, abs=2.0)


def test_a_recorded_stop_keeps_its_own_braking() -> None:
    before = np.arange(0.0, 10.0, 0.1)
    s_before = 10.0 * before - 0.5 * before**2  # 1 m/s² to a stop at 50 m
    after = np.arange(0.0, 10.0, 0.1)
    times = [*before.tolist(), *(40.0 + after).tolist()]
    stations = [*s_before.tolist(), *(50.0 + 0.5 * after**2).tolist()]
    profile, _ = recorded(times, stations, ())
    for k in (20, 60, 95, 130, 170):
        assert profile.distance(times[k]) == pytest.approx(stations[k], abs=0.6)
