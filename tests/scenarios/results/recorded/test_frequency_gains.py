"""Gains by frequency against transfer functions."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import freqs, lsim

from scenarios.results.frequency_gains import estimated, frequency_gains
from tests.made.scenarios.known_string import STEP, KnownString
from tests.made.scenarios.messages import gps

Floats = NDArray[np.float64]
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


@cache
def convoy() -> KnownString:
    """Three vehicles: each follower has Ploeg's transfer of speed, and v3 a halved error of v2."""
    speeds = [braking(60.0)]
    times = STEP * np.arange(speeds[0].size)
    for _ in range(2):
        speeds.append(lsim(PLOEG, speeds[-1], times)[1])
    error = 0.1 * np.gradient(speeds[1], STEP)
    return KnownString([20.0 + speed for speed in speeds], [error, 0.5 * error])


def test_speeds_of_all_followers_are_compared_with_the_vehicle_ahead() -> None:
    gains = frequency_gains(convoy().run(more=[gps("v2", 0)]))
    assert set(gains.vehicle) == {"v2", "v3"}
    _, expected = freqs(*PLOEG, worN=2.0 * math.pi * gains.frequency_hz)
    assert gains.gain == pytest.approx(np.abs(expected), rel=0.02)


@pytest.mark.parametrize(("factor", "known"), [(0.0, {"v3"}), (0.9, {"v3"}), (1.1, set())])
def test_spacing_errors_begin_with_the_first_follower_above_the_noise(
    factor: float, known: set[str]
) -> None:
    """Two positions explain √2 times their standard deviation."""
    error = 0.1 * np.gradient(convoy().speeds[1], STEP)
    deviation = factor * float(np.sqrt(np.mean(error**2))) / math.sqrt(2.0)
    pose = replace(gps("v2", 0), position_accuracy_m=deviation)
    gains = frequency_gains(convoy().run(more=[pose]), "spacing")
    assert set(gains.vehicle) == known
    assert gains.gain == pytest.approx(np.full(len(gains), 0.5), rel=1e-3)
    assert np.abs(gains.phase_rad).max(initial=0.0) < 1e-3


def test_equal_signals_have_a_gain_of_one_and_scaled_ones_their_factor() -> None:
    x = np.diff(braking(40.0))
    for factor in (1.0, 1.7):
        for one in estimated("v2", x, factor * x, STEP):
            assert one.gain == pytest.approx(factor)
            assert one.coherence == pytest.approx(1.0)
