"""The joint covariance against closed forms of Gauss–Markov processes."""

import math

import numpy as np
import pytest

from vehicles.car.positioning.drift import Drift, draw_truncated
from vehicles.car.positioning.gnss_settings import GnssSettings, StateErrors
from vehicles.car.positioning.stated_errors import LEAST_NOISE, stated_errors
from vehicles.driver.ego.covariance import AcrossCovariance, AlongCovariance
from vehicles.driver.ego.joint_covariance import (
    EAST,
    FIRST_ERROR,
    NORTH,
    JointCovariance,
    Step,
)
from vehicles.schedule import SECOND

FLOAT = GnssSettings(
    fix="float", position_noise=0.0, drift=Drift(0.19, 100.0), entry_jump=0.2, rate=1.0
)


STATED = stated_errors(FLOAT)
DRIFT = next(error for error in STATED.lasting if "float" in error.states)
COLUMN = FIRST_ERROR + 2 * STATED.lasting.index(DRIFT)


def entry_deviation(settings: GnssSettings) -> float:
    """Deviation of the drift in the state "float" when it is entered."""
    drifts = [error for error in stated_errors(settings).lasting if "float" in error.states]
    return drifts[0].entry_deviation or 0.0


def standing(span: float) -> Step:
    """A step of a car that stands, without errors of its sensors."""
    return Step(span, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("spans", [(0.02,) * 500, (5.0, 0.5, 30.0), (1000.0,)])
def test_a_drift_keeps_its_stationary_variance(spans: tuple[float, ...]) -> None:
    joint = JointCovariance(STATED)
    for span in spans:
        joint.grow(standing(span))
    assert joint.variance(COLUMN) == pytest.approx(0.19**2, rel=1e-9)


def test_a_restarted_drift_returns_to_its_stationary_variance() -> None:
    """σ² + (σ₀² - σ²) exp(-2 t / τ), with σ₀ of the jump at the entry."""
    joint = JointCovariance(STATED)
    joint.enter("float", 0)
    entry = entry_deviation(FLOAT)
    assert joint.variance(COLUMN) == pytest.approx(entry**2)
    for seconds in range(1, 200):
        joint.grow(standing(1.0))
        expected = 0.19**2 + (entry**2 - 0.19**2) * math.exp(-2.0 * seconds / 100.0)
        assert joint.variance(COLUMN) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("radius", [0.05, 0.2, 0.5, 3.0])
def test_the_deviation_of_a_jump_is_that_of_its_distribution(radius: float) -> None:
    settings = GnssSettings(fix="float", drift=Drift(0.19), entry_jump=radius)
    random = np.random.default_rng(7)
    draws = [draw_truncated(0.19, radius, tuple(pair)) for pair in random.random((20_000, 2))]
    assert entry_deviation(settings) == pytest.approx(float(np.std(draws)), rel=0.02)


@pytest.mark.parametrize("fixes", [2, 10, 300])
def test_a_standing_car_averages_its_drift_as_the_best_linear_estimate(fixes: int) -> None:
    """The mean of n samples of correlation r: σ² (1 + r) / (n - (n - 2) r).

    Source: best linear unbiased estimate of the mean of a first-order autoregressive process.
    """
    joint = JointCovariance.at_fix(STATED, "float", 0, (0.0, 0.0, 0.0))
    for _ in range(fixes - 1):
        joint.grow(standing(1.0))
        joint.by_position(0.0, 0.0, "float")
    r = math.exp(-1.0 / 100.0)
    expected = 0.19**2 * (1.0 + r) / (fixes - (fixes - 2) * r) + LEAST_NOISE**2
    for axis in (EAST, NORTH):
        assert joint.variance(axis) == pytest.approx(expected, rel=1e-3)


def test_dead_reckoning_grows_as_with_the_covariance_for_white_noise() -> None:
    """On the east axis, without fixes: both filters have the same model of the car."""
    along, across = AlongCovariance(1e-4, 1e-2), AcrossCovariance(1e-4, 3e-6, 3e-6)
    yaw, lever = 0.7, 1.2
    joint = JointCovariance.joined(STATED, along, across, yaw)
    for _ in range(200):
        along.grow(0.02, 2e-5)
        across.grow(0.02, 0.4, lever, 1e-5, 6e-8)
        east, north = 0.4 * math.cos(yaw), 0.4 * math.sin(yaw)
        joint.grow(Step(0.02, east, north, yaw, lever, 0.0, 2e-5, 1e-5, 6e-8))
    expected = math.sqrt(along.aa), math.sqrt(across.cc), math.sqrt(across.hh)
    assert joint.deviations(yaw) == pytest.approx(expected, rel=1e-9)


def test_the_stated_model_is_scaled_by_the_stated_accuracy() -> None:
    settings = GnssSettings(while_float=StateErrors(0.1, Drift(0.19), accuracy=0.05))
    stated = stated_errors(settings)
    assert stated.white["float"] == pytest.approx((0.05 * 0.1) ** 2)
    assert [error.deviation for error in stated.lasting if "float" in error.states] == [
        pytest.approx(0.05 * 0.19)
    ]
    assert stated.is_white("fixed")


def test_a_fix_after_an_outage_restarts_the_drift() -> None:
    joint = JointCovariance.at_fix(STATED, "float", 0, (0.0, 0.0, 0.0))
    joint.enter("float", SECOND)
    assert joint.values[EAST, COLUMN] < 0.0  # the next fix in time: the same drift
    joint.enter("float", 4 * SECOND)
    assert joint.values[EAST, COLUMN] == 0.0
