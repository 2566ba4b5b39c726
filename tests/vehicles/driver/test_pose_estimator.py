import math
from collections.abc import Callable, Iterator
from dataclasses import astuple, replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicles.car.dynamics import Actuation, Body, advance
from vehicles.car.gnss import Fix, GnssNoise, GnssReceiver
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.own_state import Pose
from vehicles.driver.pose_estimator import (
    HEADING_GAIN,
    JUMPS_BELIEVED,
    POSITION_GAIN,
    PoseEstimator,
)
from vehicles.geometry.geodesy import wrap_angle

MS = 1_000_000
SILENT = GnssNoise(position=0.0, heading=0.0, speed=0.0, yaw_rate=0.0)


def fix_of(body: Body, seq: int, at: int) -> Fix:
    yaw = wrap_angle(body.yaw)
    return Fix(seq, at, body.east, body.north, yaw, body.speed, body.yaw_rate)


def straight(seq: int, east: float | None = None, **changes: float) -> Fix:
    """Fix of a car that goes east at 20 m/s, every 50 ms."""
    fix = Fix(seq, seq * 50 * MS, seq * 1.0, 0.0, 0.0, 20.0, 0.0)
    return replace(fix, east=fix.east if east is None else east, **changes)  # type: ignore[arg-type]


def settled(speed: float, steering: float) -> Body:
    body = Body(0.0, 0.0, 0.4, speed)
    for _ in range(200):
        body = advance(body, Actuation(steering, 0.0), 0.02, CAR)
    return body


def run(
    body: Body, command: Callable[[float], Actuation], noise: GnssNoise, seconds: float
) -> Iterator[tuple[Body, Pose]]:
    """True and estimated pose every 10 ms; fixes come every 50 ms."""
    gnss = GnssReceiver(noise, 20.0, 0, np.random.default_rng(3))
    estimator = PoseEstimator(CAR)
    for k in range(round(seconds * 100)):
        fix = gnss.measure(body, k * 10 * MS)
        if fix is not None:
            estimator.correct(fix)
        yield body, estimator.at(k * 10 * MS)
        body = advance(body, command(k * 0.01), 0.01, CAR)


def held(command: Actuation, _: float) -> Actuation:
    return command


def offset(body: Body, pose: Pose) -> tuple[float, float]:
    """Estimate minus truth along and across the body (m)."""
    east, north = pose.east - body.east, pose.north - body.north
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    return east * cos + north * sin, north * cos - east * sin


@pytest.mark.parametrize(
    ("speed", "radius", "bound"), [(30.0, 300.0, 0.005), (4.0, 8.0, 0.02), (30.0, -300.0, 0.005)]
)
def test_no_bias_in_steady_cornering(speed: float, radius: float, bound: float) -> None:
    steering = (CAR.wheelbase + CAR.steer_gradient * speed**2) / radius
    body = settled(speed, steering)
    for truth, pose in run(body, lambda _: Actuation(steering, 0.0), SILENT, 8.0):
        assert math.hypot(*offset(truth, pose)) < min(bound, 1e-4)
        assert abs(wrap_angle(pose.yaw - truth.yaw)) < 1e-5


def test_mean_error_in_noisy_steady_cornering_is_within_the_bias_allowed() -> None:
    for speed, radius, bound in ((30.0, 300.0, 0.005), (4.0, 8.0, 0.02)):
        steering = (CAR.wheelbase + CAR.steer_gradient * speed**2) / radius
        command = Actuation(steering, 0.0)
        pairs = run(settled(speed, steering), partial(held, command), GnssNoise(), 40.0)
        offsets = [offset(truth, pose) for truth, pose in pairs]
        assert np.max(np.abs(np.mean(offsets, axis=0))) < bound


def test_dead_reckoning_keeps_to_the_arc_for_a_second() -> None:
    for speed, steering in ((30.0, 0.011), (4.0, 0.35)):
        body = settled(speed, steering)
        estimator = PoseEstimator(CAR)
        estimator.correct(fix_of(body, 0, 0))
        later = advance(body, Actuation(steering, 0.0), 1.0, CAR)
        pose = estimator.at(1000 * MS)
        assert (pose.east, pose.north) == pytest.approx((later.east, later.north), abs=1e-4)
        assert pose.yaw == pytest.approx(wrap_angle(later.yaw), abs=1e-5)


def test_noise_is_passed_on_as_the_gains_say() -> None:
    """Standing car: the filter of a constant is a mean with gain K, variance K / (2 - K)."""
    noise = replace(SILENT, position=0.02, heading=0.002)
    body = Body(0.0, 0.0, 0.0, 0.0)
    poses = [pose for _, pose in run(body, lambda _: Actuation(0.0, 0.0), noise, 400.0)][100::5]
    norths, yaws = np.array([p.north for p in poses]), np.array([p.yaw for p in poses])
    expected = 0.02 * math.sqrt(POSITION_GAIN / (2.0 - POSITION_GAIN))
    assert np.std(norths) == pytest.approx(expected, rel=0.05)
    expected = 0.002 * math.sqrt(HEADING_GAIN / (2.0 - HEADING_GAIN))
    assert np.std(yaws) == pytest.approx(expected, rel=0.08)


def test_moving_estimate_halves_the_noise_of_a_fix() -> None:
    body = settled(30.0, 0.0)
    pairs = list(run(body, lambda _: Actuation(0.0, 0.0), GnssNoise(), 60.0))[200:]
    along, across = np.array([offset(*pair) for pair in pairs]).T
    assert np.std(across) < 0.010
    assert np.std(along) < 0.010
    assert np.std([wrap_angle(p.yaw - b.yaw) for b, p in pairs]) < 0.0005


def test_lane_change_and_braking_leave_little_lag() -> None:
    bend = (CAR.wheelbase + CAR.steer_gradient * 900.0) / 300.0

    def swerve(seconds: float) -> Actuation:
        sign = 1 if seconds < 1.0 else -1 if seconds < 3.0 else 1 if seconds < 4.0 else 0
        return Actuation(sign * bend, 0.0)

    offsets = [offset(*pair) for pair in run(Body(0.0, 0.0, 0.0, 30.0), swerve, SILENT, 6.0)]
    assert np.max(np.abs(offsets)) < 0.015
    braking = run(Body(0.0, 0.0, 0.0, 30.0), lambda _: Actuation(0.0, -3.0), SILENT, 9.0)
    assert max(math.hypot(*offset(*pair)) for pair in braking) < 0.005


def test_first_fix_is_taken_as_it_is_and_the_next_ones_are_averaged() -> None:
    estimator = PoseEstimator(CAR)
    estimator.correct(Fix(0, 0, 1.0, 2.0, 0.5, 0.0, 0.0))
    assert estimator.at(0) == Pose(1.0, 2.0, 0.5, 0.0, 0.0)
    estimator.correct(Fix(1, 50 * MS, 1.2, 2.0, 0.5, 0.0, 0.0))
    assert estimator.at(50 * MS).east == pytest.approx(1.1)
    estimator.correct(Fix(2, 100 * MS, 1.4, 2.0, 0.5, 0.0, 0.0))
    assert estimator.at(100 * MS).east == pytest.approx(1.2)


def test_speed_and_yaw_rate_are_those_of_the_last_fix() -> None:
    estimator = PoseEstimator(CAR)
    estimator.correct(straight(0))
    estimator.correct(straight(1, speed=21.0, yaw_rate=0.01))
    pose = estimator.at(60 * MS)
    assert (pose.speed, pose.yaw_rate) == (21.0, 0.01)


def test_there_is_no_pose_before_the_first_fix() -> None:
    with pytest.raises(ValueError, match="before the first fix"):
        PoseEstimator(CAR).at(0)


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


def test_outliers_that_disagree_are_never_believed() -> None:
    estimator = estimator_at(19)
    for k in range(20, 40):
        estimator.correct(straight(k, east=1000.0 * (k % 2) + 100.0 * k))
    assert estimator.at(2000 * MS).east == pytest.approx(40.0, abs=1e-6)


def test_a_jump_that_lasts_is_believed_at_its_third_fix() -> None:
    estimator = estimator_at(19)
    for k in range(20, 20 + JUMPS_BELIEVED - 1):
        estimator.correct(straight(k, east=k + 50.0))
        assert estimator.at(k * 50 * MS).east == pytest.approx(k, abs=1e-6)
    last = 20 + JUMPS_BELIEVED - 1
    estimator.correct(straight(last, east=last + 50.0))
    assert estimator.at(last * 50 * MS).east == pytest.approx(last + 50.0, abs=1e-6)


def test_outliers_with_good_fixes_between_them_are_never_believed() -> None:
    estimator = estimator_at(19)
    for k in range(20, 40):
        estimator.correct(straight(k, east=k + (50.0 if k % 2 else 0.0)))
    assert estimator.at(2000 * MS).east == pytest.approx(40.0, abs=1e-6)


def test_after_an_outage_a_fix_may_lie_further_off() -> None:
    estimator = estimator_at(19)
    late = straight(219, east=219.0 + 20.0)  # 10 s later, 20 m from dead reckoning
    estimator.correct(late)
    assert estimator.at(late.measured_at).east > 219.0


@pytest.mark.parametrize("field", ["east", "north", "yaw", "speed", "yaw_rate"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_fixes_that_are_not_finite_are_ignored(field: str, value: float) -> None:
    estimator = PoseEstimator(CAR)
    estimator.correct(straight(0, **{field: value}))
    with pytest.raises(ValueError, match="before the first fix"):
        estimator.at(0)
    estimator = estimator_at(5)
    before = estimator.at(300 * MS)
    estimator.correct(straight(6, **{field: value}))
    assert estimator.at(300 * MS) == before


def test_old_and_repeated_fixes_are_ignored() -> None:
    estimator = estimator_at(5)
    before = estimator.at(300 * MS)
    estimator.correct(straight(5, east=5.1))
    estimator.correct(straight(3, east=3.1))
    assert estimator.at(300 * MS) == before


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
@settings(max_examples=60)
def test_no_sequence_of_fixes_gives_anything_but_finite_poses(
    readings: list[tuple[int, float, float, float, float, float]],
) -> None:
    estimator = PoseEstimator(CAR)
    at = 0
    for seq, (gap_ms, *values) in enumerate(readings):
        at += gap_ms * MS
        estimator.correct(Fix(seq, at, *values))
        pose = estimator.at(at + 20 * MS)
        assert all(map(math.isfinite, astuple(pose)))
        assert -math.pi < pose.yaw <= math.pi
