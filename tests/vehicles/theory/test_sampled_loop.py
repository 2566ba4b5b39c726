"""The sampled loop, against the continuous loop, the filter, and a simulated car."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.imu import ImuSettings, Motion
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import NOMINAL_GAINS, Loading, VehicleParameters, loaded
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import PoseEstimator
from vehicles.driver.steering import FeedforwardFeedback
from vehicles.driver.tracking import TrackingErrors
from vehicles.schedule import SECOND, Cadence, instants
from vehicles.theory.linear_model import closed_loop_at
from vehicles.theory.sampled_loop import (
    SampledLoop,
    sampled_decay,
    stationary_gains,
)

FULL = loaded(CAR, Loading(front_passengers=1, rear_passengers=3))
UNBIASED = ImuSettings(speed_bias=0.0, yaw_rate_bias=0.0)
LOOP = SampledLoop(CAR, CAR, NOMINAL_GAINS, imu=UNBIASED)


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0, 36.0])
@pytest.mark.parametrize("car", [CAR, FULL], ids=["empty", "full"])
def test_it_converges_to_the_continuous_loop(speed: float, car: VehicleParameters) -> None:
    continuous = -float(np.max(np.linalg.eigvals(closed_loop_at(car, NOMINAL_GAINS, speed)).real))
    errors = []
    for rate in (200.0, 400.0, 800.0):
        loop = replace(LOOP, parameters=car, imu_hz=None, control_hz=rate)
        errors.append(abs(sampled_decay(loop, speed) - continuous))
    assert errors[2] < 0.05
    assert errors[0] > 1.8 * errors[1] > 3.2 * errors[2]  # a hold is a delay of half a period


@pytest.mark.parametrize("noise", [(0.02, 0.00175), (0.3, 0.01)])
@pytest.mark.parametrize(("speed", "gnss_hz"), [(30.0, 20.0), (8.0, 20.0), (30.0, 2.0)])
def test_stationary_gains_are_those_of_the_filter(
    speed: float, gnss_hz: float, noise: tuple[float, float]
) -> None:
    """The stationary Kalman gains, against the settled filter of a vehicle.

    Within 3 %, as the filter neglects that the heading changes between two fixes.
    """
    gains = stationary_gains(CAR, 50.0, gnss_hz, noise, UNBIASED, speed)
    for column, (offset, turned) in enumerate(((0.01, 0.0), (0.0, 0.001))):
        gnss = GnssSettings(position_noise=noise[0], heading_noise=noise[1])
        estimator = PoseEstimator(CAR, gnss, UNBIASED)
        last = round(100 * gnss_hz)
        for k, at in enumerate(
            sorted({*instants(0, 101 * SECOND, 50), *instants(0, 101 * SECOND, gnss_hz)})
        ):
            if k % 1 == 0 and Cadence(0, 50.0).due(at):
                estimator.move(at, speed, 0.0)
            seq = Cadence(0, gnss_hz).index(at)
            if seq is None:
                continue
            shift = seq == last
            place, yaw = (offset, turned) if shift else (0.0, 0.0)
            fix = Fix(seq, at, speed * at / SECOND, place, yaw, speed, 0.0)
            estimator.correct(replace(fix, accuracy=noise[0]))
            if shift:
                break
        pose = estimator.at(at)
        given = (offset, turned)[column]
        assert [pose.north / given, pose.yaw / given] == pytest.approx(
            gains[:, column].tolist(), rel=0.03
        )


@dataclass
class Driven:
    """A car on the x axis with the paper's law and error-free sensors."""

    loop: SampledLoop
    speed: float

    def decay(self, seconds: float) -> float:
        """Decay rate (1/s) of a small offset, from the second half of the time."""
        loop, settling = self.loop, 20 * SECOND
        body = Body(0.0, 0.0, 0.0, self.speed)
        law = FeedforwardFeedback(loop.assumed, loop.gains)
        estimator = PoseEstimator(loop.assumed, loop.gnss, loop.imu, loop.imu_hz or 1.0)
        control, imu = Cadence(0, loop.control_hz), Cadence(0, loop.imu_hz or 1.0)
        gnss = Cadence(0, loop.gnss_hz)
        end = settling + round(seconds * SECOND)
        rates = (loop.control_hz, loop.imu_hz or loop.control_hz, loop.gnss_hz)
        ticks = sorted({at for rate in rates for at in instants(0, end, rate)})
        steering, places = 0.0, []
        for now, after in zip(ticks, [*ticks[1:], end], strict=True):
            if now == settling:
                body.north += 1e-6
            motion = Motion(body.speed, body.yaw_rate) if imu.due(now) else None
            seq = gnss.index(now)
            fix = None
            if seq is not None:
                fix = Fix(seq, now, body.east, body.north, body.yaw, self.speed, body.yaw_rate)
            estimator.update(now, fix, motion)
            if control.due(now):
                pose = estimator.at(now) if loop.imu_hz else exactly(body)
                errors = TrackingErrors(pose.north, pose.yaw, pose.yaw_rate, 0.0)
                steering = law.steer(errors, self.speed).steering
            off = math.hypot(body.north, body.yaw, body.yaw_rate, body.steering)
            places.append((now - settling, off))
            body = advance(body, Actuation(steering, 0.0), (after - now) / SECOND, CAR)
        thirds = [
            max(place for at, place in places if first <= at / SECOND / seconds < first + 0.3)
            for first in (0.35, 0.7)
        ]
        return -math.log(thirds[1] / thirds[0]) / (0.35 * seconds)


def exactly(body: Body) -> Pose:
    return Pose(body.east, body.north, body.yaw, body.speed, body.yaw_rate)


@pytest.mark.parametrize(
    ("speed", "control_hz", "imu_hz", "gnss_hz", "seconds"),
    [
        (10.0, 50.0, 50.0, 20.0, 24),
        (30.0, 50.0, 50.0, 20.0, 16),
        (30.0, 50.0, 50.0, 1.0, 24),
        (30.0, 50.0, None, 20.0, 9),
        (30.0, 50.0, 12.5, 12.5, 16),
        (30.0, 50.0, 10.0, 10.0, 16),  # unstable, from here on
        (30.0, 50.0, 8.0, 8.0, 12),
        (30.0, 50.0, 11.0, 11.0, 12),
        (36.0, 50.0, 12.0, 20.0, 12),
        (15.0, 50.0, 4.0, 4.0, 4),
        (60.0, 10.0, None, 20.0, 12),
    ],
)
def test_a_simulated_car_decays_and_diverges_as_computed(
    speed: float, control_hz: float, imu_hz: float | None, gnss_hz: float, seconds: float
) -> None:
    """The nonlinear car with filter and law, on both sides of the stability boundary."""
    loop = replace(LOOP, control_hz=control_hz, imu_hz=imu_hz, gnss_hz=gnss_hz)
    computed = sampled_decay(loop, speed)
    driven = Driven(loop, speed).decay(seconds)
    assert driven == pytest.approx(computed, rel=0.2, abs=0.1)
    assert (computed > 0.0) == (driven > 0.0)


@pytest.mark.parametrize("speed", [4.0, 10.0, 20.0, 30.0, 36.0])
@pytest.mark.parametrize("car", [CAR, FULL], ids=["empty", "full"])
def test_with_an_inertial_sensor_at_the_control_rate_any_receiver_is_stable(
    speed: float, car: VehicleParameters
) -> None:
    for gnss_hz in (1.0, 2.0, 5.0, 10.0, 20.0):
        assert sampled_decay(replace(LOOP, parameters=car, gnss_hz=gnss_hz), speed) > 0.0
