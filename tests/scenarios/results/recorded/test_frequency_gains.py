"""Gains by frequency against transfer functions."""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import freqs, lsim

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.data_table import DataTable
from scenarios.results.frequency_gains import estimated, frequency_gains
from scenarios.results.run_record import RunRecord

Floats = NDArray[np.float64]
STEP = 0.02
LAG, HEADWAY, GAIN = 0.5, 1.2, 0.1
PLOEG = [1.0], [0.5, 1.0]
ACC = [1.0, GAIN], [HEADWAY * LAG, HEADWAY, 1.0 + GAIN * HEADWAY, GAIN]


def braking(duration: float) -> Floats:
    """Speed (m/s) of a lead that brakes by 6 m/s and accelerates again."""
    times = np.arange(0.0, duration, STEP)
    speed: Floats = np.interp(times, [5.0, 8.0, 11.0, 14.0], [0.0, -6.0, -6.0, 0.0])
    return speed


def sinusoid(duration: float) -> Floats:
    times = np.arange(0.0, duration, STEP)
    speed: Floats = 1.4 * np.sin(2.0 * math.pi * 0.2 * np.maximum(times - 5.0, 0.0))
    return speed


@pytest.mark.parametrize("transfer", [PLOEG, ACC], ids=["ploeg", "acc"])
def test_a_braking_pulse_gives_the_transfer_function(
    transfer: tuple[list[float], list[float]],
) -> None:
    speed = braking(60.0)
    times = STEP * np.arange(speed.size)
    response = lsim(transfer, speed, times)[1]
    found = estimated("v2", np.diff(speed), np.diff(response), STEP)
    assert len(found) >= 5
    _, expected = freqs(*transfer, worN=[2.0 * math.pi * one.frequency_hz for one in found])
    for one, true in zip(found, expected, strict=True):
        assert one.gain == pytest.approx(abs(true), rel=0.02)
        assert one.phase_rad == pytest.approx(np.angle(true), abs=0.05)
        assert one.low <= one.gain <= one.high


def test_a_sinusoid_gives_the_gain_around_its_frequency() -> None:
    speed = sinusoid(40.0)
    response = lsim(PLOEG, speed, STEP * np.arange(speed.size))[1]
    found = estimated("v2", np.diff(speed), np.diff(response), STEP)
    assert min(abs(one.frequency_hz - 0.2) for one in found) < 0.01
    assert all(one.frequency_hz == pytest.approx(0.2, abs=0.15) for one in found)
    _, expected = freqs(*PLOEG, worN=[2.0 * math.pi * one.frequency_hz for one in found])
    assert [one.gain for one in found] == pytest.approx(np.abs(expected), rel=0.03)


@pytest.mark.parametrize("start_s", [6.0, 8.1, 11.2])
@pytest.mark.parametrize("transfer", [PLOEG, ACC], ids=["ploeg", "acc"])
def test_a_piece_of_an_oscillation_gives_the_gain_at_its_frequency_only(
    start_s: float, transfer: tuple[list[float], list[float]]
) -> None:
    """Cut at the beginning, the record would have further frequencies with wrong gains."""
    speed = sinusoid(40.0)
    response = lsim(transfer, speed, STEP * np.arange(speed.size))[1]
    piece = slice(round(start_s / STEP), round((start_s + 19.0) / STEP))
    found = estimated("v2", np.diff(speed)[piece], np.diff(response)[piece], STEP)
    assert [one.frequency_hz for one in found] == pytest.approx([0.2], abs=0.005)
    _, expected = freqs(*transfer, worN=[2.0 * math.pi * 0.2])
    assert found[0].gain == pytest.approx(float(np.abs(expected[0])), rel=0.01)


def test_unrelated_signals_have_no_gain() -> None:
    random = np.random.default_rng(7)
    x, y = random.normal(size=(2, 3000))
    assert estimated("v2", x, y, STEP) == []


class StraightRecord(RunRecord):
    """A run of vehicles on a straight road with given speeds (m/s) and gaps' errors (m)."""

    def __init__(
        self,
        scenario: Scenario,
        speeds: list[Floats],
        errors: list[Floats],
        deviation: float = 0.0,
    ) -> None:
        """`deviation` (m) is the standard deviation of positions that the receivers report."""
        self._gps = {"v2": DataTable({"position_accuracy_m": np.array([deviation])})}
        self.known_scenario = scenario
        self.vehicle_names = scenario.vehicle_names
        at = np.arange(speeds[0].size) * round(STEP * 1e9)
        station = STEP * np.cumsum(speeds[0])
        tables = [(speeds[0], station - station[0])]
        for place, (speed, error) in enumerate(zip(speeds[1:], errors, strict=True), 1):
            policy = scenario.spacing_policy(place)
            desired = policy.standstill + policy.headway * speed
            tables.append((speed, tables[-1][1] - desired - error))
        self._true = {
            name: DataTable(
                {"at_ns": at, "speed_mps": speed, "station_m": place, "distance_m": place}
            )
            for name, (speed, place) in zip(self.vehicle_names, tables, strict=True)
        }

    def columns_of(self, topic: str) -> Any:
        return self._gps if topic == "gps" else {}

    def topics_of(self, vehicle: str) -> set[str]:
        return {"truth"} if vehicle in self._true else set()

    def true_table(self, vehicle: str) -> DataTable:
        return self._true[vehicle]


@cache
def highway() -> Scenario:
    return load_scenario("highway", ["convoy.vehicles=3"])


@cache
def recorded() -> StraightRecord:
    """Three vehicles: each follower has Ploeg's transfer of speed, and v3 a halved error of v2."""
    speeds = [braking(60.0)]
    times = STEP * np.arange(speeds[0].size)
    for _ in range(2):
        speeds.append(lsim(PLOEG, speeds[-1], times)[1])
    error = 0.1 * np.gradient(speeds[1], STEP)
    return StraightRecord(highway(), [20.0 + speed for speed in speeds], [error, 0.5 * error])


def test_speeds_of_all_followers_are_compared_with_the_vehicle_ahead() -> None:
    gains = frequency_gains(recorded())
    assert set(gains.vehicle) == {"v2", "v3"}
    _, expected = freqs(*PLOEG, worN=2.0 * math.pi * gains.frequency_hz)
    assert gains.gain == pytest.approx(np.abs(expected), rel=0.02)


def test_spacing_errors_begin_with_the_first_follower() -> None:
    gains = frequency_gains(recorded(), "spacing")
    assert set(gains.vehicle) == {"v3"}
    assert gains.gain == pytest.approx(0.5)
    assert np.abs(gains.phase_rad).max() < 1e-6


def test_spacing_errors_at_the_level_of_the_noise_have_no_gains() -> None:
    """Two positions explain √2 times their standard deviation."""
    run = recorded()
    speeds = [run.true_table(name).speed_mps for name in run.vehicle_names]
    error = 0.1 * np.gradient(speeds[1], STEP)
    rms = float(np.sqrt(np.mean(error**2)))
    for factor, has_gains in ((0.9, True), (1.1, False)):
        deviation = factor * rms / math.sqrt(2.0)
        noisy = StraightRecord(highway(), speeds, [error, 0.5 * error], deviation)
        assert bool(len(frequency_gains(noisy, "spacing").vehicle)) == has_gains


def test_equal_signals_have_a_gain_of_one_and_scaled_ones_their_factor() -> None:
    x = np.diff(braking(40.0))
    for factor in (1.0, 1.7):
        for one in estimated("v2", x, factor * x, STEP):
            assert one.gain == pytest.approx(factor)
            assert one.coherence == pytest.approx(1.0)
