import math
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from math import remainder, tau

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.driving import advance
from tests.made.vehicles.receivers import SILENT, USUAL, receiver
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.imu import ImuSettings, InertialSensor, Motion
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import Loading, VehicleParameters, loaded
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import JUMPS_ACCEPTED, PoseEstimator

MS = 1_000_000
STILL = ImuSettings(speed_noise=0.0, yaw_rate_noise=0.0, speed_bias=0.0, yaw_rate_bias=0.0)
IN_CARS = ImuSettings()
FULL = loaded(CAR, Loading(front_passengers=1, rear_passengers=3))
Command = Callable[[float], Actuation]


def straight(seq: int, east: float | None = None, **changes: float) -> Fix:
    """Fix of a car that goes east at 20 m/s, every 50 ms."""
    fix = Fix(seq, seq * 50 * MS, seq * 1.0, 0.0, 0.0, 20.0, 0.0)
    return replace(fix, east=fix.east if east is None else east, **changes)  # type: ignore[arg-type]


def turning(speed: float, radius: float, car: VehicleParameters = CAR) -> float:
    """Steering (rad) of steady cornering."""
    return (car.wheelbase + car.steer_gradient * speed * speed) / radius


def settled(speed: float, steering: float, car: VehicleParameters = CAR) -> Body:
    body = Body(0.0, 0.0, 0.4, speed)
    for _ in range(200):
        body = advance(body, Actuation(steering, 0.0), 0.02, car)
    return body


def steered(angle: float, acceleration: float = 0.0) -> Command:
    return lambda _: Actuation(angle, acceleration)


@dataclass(frozen=True)
class Sensors:
    """Sensor noise, rate of fixes, and random seed."""

    gnss: GnssSettings = USUAL
    imu: ImuSettings = IN_CARS
    gnss_hz: float = 20.0
    seed: int = 3


EXACT = Sensors(SILENT, STILL)


@dataclass(frozen=True)
class Estimate:
    """The car, its estimated pose and standard deviations.

    `innovation` is the fix minus the estimate before the fix, along and across the body (m)
    and in heading (rad), None without a fix; `before` are the deviations then.
    """

    body: Body
    pose: Pose
    deviations: tuple[float, float, float]
    innovation: tuple[float, float, float] | None = None
    before: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def error(self) -> tuple[float, float, float]:
        return off(self.pose, self.body)


def off(pose: Pose | Fix, body: Body | Pose) -> tuple[float, float, float]:
    """Pose minus truth along and across the body (m) and in heading (rad)."""
    east, north = pose.east - body.east, pose.north - body.north
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    return east * cos + north * sin, north * cos - east * sin, remainder(pose.yaw - body.yaw, tau)


def run(
    body: Body, command: Command, sensors: Sensors, seconds: float, car: VehicleParameters = CAR
) -> Iterator[Estimate]:
    """True and estimated pose every 10 ms; the sensor in the car reads every 20 ms."""
    gnss = receiver(replace(sensors.gnss, rate=sensors.gnss_hz), seed=sensors.seed)
    stream = np.random.default_rng([sensors.seed, 1])
    imu = InertialSensor(sensors.imu, 50.0, 0, stream)
    estimator = PoseEstimator(CAR, sensors.gnss, sensors.imu, 50.0)
    for k in range(round(seconds * 100)):
        now = k * 10 * MS
        estimator.update(now, None, imu.measure(body, now))
        fix = gnss.measure(body, now)
        comparison: tuple[tuple[float, float, float] | None, tuple[float, float, float]]
        comparison = None, (0.0, 0.0, 0.0)
        if fix is not None and k:
            comparison = (off(fix, estimator.at(now)), estimator.deviations)
        estimator.update(now, fix, None)
        yield Estimate(body, estimator.at(now), estimator.deviations, *comparison)
        body = advance(body, command(k * 0.01), 0.01, car)


@pytest.mark.parametrize(("speed", "radius"), [(30.0, 300.0), (4.0, 8.0), (30.0, -300.0)])
def test_with_exact_sensors_the_state_is_exact_in_steady_cornering(
    speed: float, radius: float
) -> None:
    steering = turning(speed, radius)
    for estimate in run(settled(speed, steering), steered(steering), EXACT, 8.0):
        along, across, heading = estimate.error
        assert math.hypot(along, across) < 1e-6
        assert abs(heading) < 1e-6
        assert estimate.pose.speed == pytest.approx(estimate.body.speed, abs=1e-12)
        assert estimate.pose.yaw_rate == pytest.approx(estimate.body.yaw_rate, abs=1e-12)


def swerve(seconds: float) -> Actuation:
    """Left and back at 30 m/s, with the steering of arcs of 300 m."""
    sign = 1 if seconds < 1.0 else -1 if seconds < 3.0 else 1 if seconds < 4.0 else 0
    return Actuation(sign * turning(30.0, 300.0), 0.0)


@pytest.mark.parametrize("car", [CAR, FULL], ids=["empty", "load not known"])
def test_a_swerve_is_estimated_to_a_centimetre(car: VehicleParameters) -> None:
    """Root mean square over the swerve and over seeds."""
    squares = []
    for seed in range(8):
        body = Body(0.0, 0.0, 0.0, 30.0)
        drive = run(body, lambda t: swerve(t - 4.0), Sensors(seed=seed), 10.0, car)
        squares += [estimate.error[1] ** 2 for estimate in drive if estimate.body.distance > 120.0]
    assert math.sqrt(np.mean(squares)) < 0.0105


def mean_squares(drives: list[list[Estimate]]) -> tuple[list[float], list[float]]:
    """Means of error² / variance and of innovation² / variance, a second apart each."""
    errors, innovations = [], []
    noise = (USUAL.position_noise, USUAL.position_noise, USUAL.heading_noise)
    for drive in drives:
        errors += [np.array(estimate.error) / estimate.deviations for estimate in drive[400::105]]
        innovations += [
            np.array(estimate.innovation) / np.hypot(estimate.before, noise)
            for estimate in drive[400:]
            if estimate.innovation is not None
        ]
    return (
        np.mean(np.square(errors), axis=0).tolist(),
        np.mean(np.square(innovations), axis=0).tolist(),
    )


@pytest.mark.spread(2)
@pytest.mark.parametrize("gnss_hz", [20.0, 5.0, 1.0])
def test_errors_match_the_covariance_of_the_filter(gnss_hz: float) -> None:
    """Normalised squares of errors and innovations are 1 in the mean, on a straight.

    Bounds are those of chi² with the number of seeds as degrees of freedom, at four deviations, as
    errors of one drive depend on one another; across, drift without a cause is allowed for that
    this car does not have.
    """
    seeds = 25
    drives = [
        list(run(Body(0.0, 0.0, 0.4, 30.0), steered(0.0), Sensors(gnss_hz=gnss_hz, seed=s), 12.0))
        for s in range(seeds)
    ]
    errors, innovations = mean_squares(drives)
    slack = 4.0 * math.sqrt(2.0 / (2.0 * seeds))
    for value in (*errors, *innovations):
        assert 1.0 - slack < value < 1.0 + slack
    # There are more innovations than errors, so their mean is more precise.
    assert innovations == pytest.approx([1.0] * 3, abs=0.1 if gnss_hz == 20.0 else 0.3)


@pytest.mark.spread(2)
@pytest.mark.parametrize(("speed", "radius"), [(30.0, 500.0), (15.0, 100.0), (4.0, 8.0)])
def test_in_curves_errors_do_not_exceed_the_covariance_of_the_filter(
    speed: float, radius: float
) -> None:
    """The filter allows for a load that this car does not have."""
    steering, drives = turning(speed, radius), []
    for seed in range(20):
        drive = run(settled(speed, steering), steered(steering), Sensors(seed=seed), 10.0)
        drives.append(list(drive))
    errors, innovations = mean_squares(drives)
    assert max(errors) < 1.5
    assert min(errors) > 0.35
    assert max(innovations) < 1.1


def test_without_fixes_dead_reckoning_stays_within_its_covariance() -> None:
    """Ten seconds of a swerve without fixes, after the biases were estimated."""
    body = Body(0.0, 0.0, 0.0, 30.0)
    imu = InertialSensor(IN_CARS, 50.0, 0, np.random.default_rng(5))
    gnss = receiver(replace(USUAL, rate=10.0), seed=6)
    estimator = PoseEstimator(CAR)
    for k in range(2000):
        now = k * 20 * MS
        fix = gnss.measure(body, now) if k < 1500 else None
        estimator.update(now, fix, imu.measure(body, now))
        body = advance(body, swerve(k * 0.02 - 32.0) if k > 1600 else Actuation(0, 0), 0.02, CAR)
    along, across, _ = off(estimator.at(now), body)
    limits = estimator.deviations
    assert abs(along) < 4.0 * limits[0] + 30.0 * 0.02
    assert abs(across) < 4.0 * limits[1]
    assert limits[1] < 2.0


def test_the_first_fix_is_adopted_and_the_next_ones_are_averaged() -> None:
    """For a standing car the n-th fix has the weight 1/n."""
    estimator = PoseEstimator(CAR, imu=STILL)
    estimator.update(0, Fix(0, 0, 1.0, 2.0, 0.5, 0.0, 0.0), Motion(0.0, 0.0))
    assert estimator.at(0) == Pose(1.0, 2.0, 0.5, 0.0, 0.0)
    estimator.correct(Fix(1, 50 * MS, 1.02, 2.0, 0.5, 0.0, 0.0))
    assert estimator.at(50 * MS).east == pytest.approx(1.01, abs=1e-4)
    estimator.correct(Fix(2, 100 * MS, 1.04, 2.0, 0.5, 0.0, 0.0))
    assert estimator.at(100 * MS).east == pytest.approx(1.02, abs=2e-4)


def estimator_at(seq: int) -> PoseEstimator:
    estimator = PoseEstimator(CAR)
    for k in range(seq + 1):
        estimator.correct(straight(k))
    return estimator


@pytest.mark.parametrize("outlier", [straight(20, east=1000.0), straight(20, yaw=math.pi)])
def test_single_outliers_change_nothing(outlier: Fix) -> None:
    estimator = estimator_at(19)
    before = estimator.at(1000 * MS)
    estimator.correct(outlier)
    assert estimator.at(1000 * MS) == before
    estimator.correct(straight(21))
    assert estimator.at(1050 * MS).east == pytest.approx(21.0, abs=1e-9)


def test_a_lasting_jump_is_accepted_at_its_third_fix() -> None:
    estimator = estimator_at(19)
    for k in range(20, 20 + JUMPS_ACCEPTED - 1):
        estimator.correct(straight(k, east=k + 50.0))
        assert estimator.at(k * 50 * MS).east == pytest.approx(k, abs=1e-6)
    last = 20 + JUMPS_ACCEPTED - 1
    estimator.correct(straight(last, east=last + 50.0))
    assert estimator.at(last * 50 * MS).east == pytest.approx(last + 50.0, abs=1e-6)


reading = st.floats(-1e4, 1e4)


@given(
    st.lists(
        st.tuples(
            st.integers(-100, 2000), reading, reading, st.floats(-3.2, 3.2), st.floats(0, 150),
            st.floats(-10, 10),
        ),
        min_size=1, max_size=30,
    )
)  # fmt: skip
@examples(10, 60)
def test_any_sequence_of_fixes_gives_finite_poses(
    readings: list[tuple[int, float, float, float, float, float]],
) -> None:
    estimator = PoseEstimator(CAR)
    at = 0
    for seq, (gap_ms, east, north, yaw, speed, yaw_rate) in enumerate(readings):
        at += gap_ms * MS
        estimator.correct(Fix(seq, at, east, north, yaw, speed, yaw_rate))
        pose = estimator.at(at + 20 * MS)
        assert all(map(math.isfinite, astuple(pose)))
        assert -math.pi < pose.yaw <= math.pi
