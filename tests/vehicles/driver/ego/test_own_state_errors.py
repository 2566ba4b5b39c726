"""Errors of the own state against the deviations that the filter states (NEES)."""

import math
from itertools import product

import numpy as np
import pytest

from tests.vehicles.driver.ego.own_state_errors import Course, EstimatedDrive
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss_error_terms import (
    Bias,
    CommonDrift,
    Drift,
    FixOutageWindow,
    ScheduledStates,
    StateEntry,
)
from vehicles.car.gnss_settings import PRESETS, GnssSettings, Preset
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import Loading, loaded
from vehicles.schedule import MILLISECOND, SECOND

FULL = loaded(CAR, Loading(front_passengers=1, rear_passengers=3))
OUTAGE = (FixOutageWindow(8 * SECOND, 16 * SECOND),)
STATES = ScheduledStates(
    (StateEntry(4.0, "float"), StateEntry(10.0, "fixed"), StateEntry(13.0, "float"),
     StateEntry(18.0, "fixed"))
)  # fmt: skip


def preset(name: Preset, **changes: object) -> GnssSettings:
    return GnssSettings(preset=name, **{**PRESETS[name], **changes})


RECEIVERS = {
    "white": GnssSettings(),
    "drift": GnssSettings(drift=Drift(0.05, 100.0)),
    "fast drift": GnssSettings(drift=Drift(0.05, 10.0)),
    "random bias": GnssSettings(bias=Bias(0.05)),
    "configured bias": GnssSettings(bias=Bias(east=0.05)),
    "rtk_fixed": preset("rtk_fixed"),
    "rtk_float": preset("rtk_float"),
    "single": preset("single"),
    "common drift": GnssSettings(common_drift=CommonDrift(0.2, 100.0)),
    "all errors": preset(
        "rtk_fixed",
        common_drift=CommonDrift(0.2, 100.0),
        bias=Bias(0.03),
        quantisation=0.01,
        latency=100 * MILLISECOND,
    ),
    "white, outage": GnssSettings(outages=OUTAGE),
    "drift, outage": GnssSettings(drift=Drift(0.05, 100.0), outages=OUTAGE),
    "rtk_float, outage": preset("rtk_float", outages=OUTAGE),
    "white and float": GnssSettings(fix_states=STATES),
    "rtk_fixed and float": preset("rtk_fixed", fix_states=STATES),
}


def bend(speed: float, radius: float) -> Course:
    steering = Actuation((CAR.wheelbase + CAR.steer_gradient * speed * speed) / radius, 0.0)
    return Course(Body(0.0, 0.0, 0.4, speed), lambda _: steering)


COURSES = {
    "straight": Course(Body(0.0, 0.0, 0.4, 25.0), lambda _: Actuation(0.0, 0.0)),
    "bend": bend(25.0, 300.0),
    "tight bend": bend(7.0, 20.0),
    "slalom": Course(
        Body(0.0, 0.0, 0.4, 20.0), lambda t: Actuation(0.02 * math.sin(0.5 * math.pi * t), 0.0)
    ),
}
CARS = {"empty": CAR, "unknown load": FULL}


def mean_squares(drive: EstimatedDrive, seeds: int) -> np.ndarray:
    """NEES along, across and in heading, each of mean 1 if the deviations are right."""
    means = np.array([drive.normalised_squares(seed).mean(axis=0) for seed in range(seeds)])
    mean: np.ndarray = means.mean(axis=0)
    return mean


@pytest.mark.spread(5)
@pytest.mark.campaign(4, 25)
@pytest.mark.parametrize(("receiver", "course", "car"), [*product(RECEIVERS, COURSES, CARS)])
def test_errors_of_the_own_state_match_its_deviations(
    receiver: str, course: str, car: str, campaign: int
) -> None:
    drive = EstimatedDrive(RECEIVERS[receiver], COURSES[course], 24.0, car=CARS[car])
    along, across, heading = mean_squares(drive, campaign)
    assert 0.3 < (along + across) / 2.0 < 2.0
    assert across < 2.0
    assert heading < 2.0


@pytest.mark.parametrize("receiver", ["rtk_float", "configured bias"])
def test_a_filter_of_white_noise_is_too_certain_of_a_receiver_whose_errors_last(
    receiver: str,
) -> None:
    drive = EstimatedDrive(RECEIVERS[receiver], COURSES["straight"], 10.0, white_only=True)
    along, across, _ = mean_squares(drive, 4)
    assert (along + across) / 2.0 > 10.0


def test_a_receiver_that_states_a_wrong_accuracy_misleads_the_filter() -> None:
    honest = preset("rtk_float")
    overconfident = preset("rtk_float", accuracy=0.05)
    squares = [
        mean_squares(EstimatedDrive(settings, COURSES["straight"], 10.0), 4)[:2].mean()
        for settings in (honest, overconfident)
    ]
    assert squares[1] > 20.0 * squares[0]
