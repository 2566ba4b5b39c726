import math
from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.vehicles.driving import TICK, advance, apart, drive, lane_change, steer
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import TyreModel
from vehicles.car.tyres import WALKING_PACE


def steady_yaw_rate(speed: float, steering: float) -> float:
    return speed * steering / (CAR.wheelbase + CAR.steer_gradient * speed**2)


@pytest.mark.parametrize("speed", [0.5, 1.99, 2.0, 5.0, 15.0, 30.0])
@pytest.mark.parametrize("steering", [0.02, -0.05])
def test_steady_cornering_has_the_paper_s_radius(speed: float, steering: float) -> None:
    body = drive(Body(0.0, 0.0, 0.0, speed), steer(steering), 6.0)[-1]
    radius = speed / body.yaw_rate
    assert steering == pytest.approx(
        CAR.wheelbase / radius + CAR.steer_gradient * speed**2 / radius, rel=1e-9
    )
    slip = CAR.steady_slip_per_curvature(speed)
    assert body.lateral_speed == pytest.approx(slip * body.yaw_rate, rel=1e-9)


@pytest.mark.parametrize("speed", [1.0, 8.0, 30.0])
def test_steady_cornering_follows_a_circle(speed: float) -> None:
    settled = drive(Body(0.0, 0.0, 0.0, speed), steer(0.05), 6.0)[-1]
    lap = 2.0 * math.pi / settled.yaw_rate
    bodies = drive(settled, steer(0.05), lap, tick=lap / 1000)
    assert apart(bodies[0], bodies[-1]) < 1e-5
    centre = np.mean([(b.east, b.north) for b in bodies[:-1]], axis=0)
    radius = math.hypot(speed, settled.lateral_speed) / settled.yaw_rate
    for body in bodies:
        assert math.dist(centre, (body.east, body.north)) == pytest.approx(radius, abs=1e-4)
    assert bodies[-1].distance - settled.distance == pytest.approx(2 * math.pi * radius, rel=1e-6)


@given(yaw=st.floats(-10.0, 10.0), speed=st.floats(0.0, 40.0), acceleration=st.floats(-3.0, 2.0))
def test_without_steering_it_goes_straight(yaw: float, speed: float, acceleration: float) -> None:
    body = advance(Body(5.0, -7.0, yaw, speed), Actuation(0.0, acceleration), 0.5, CAR)
    rolling = min(0.5, speed / -acceleration) if acceleration < 0.0 else 0.5
    distance = speed * rolling + acceleration * rolling**2 / 2.0
    assert body.east == pytest.approx(5.0 + distance * math.cos(yaw), abs=1e-9)
    assert body.north == pytest.approx(-7.0 + distance * math.sin(yaw), abs=1e-9)
    assert (body.yaw, body.yaw_rate, body.lateral_speed) == (yaw, 0.0, 0.0)
    assert body.distance == pytest.approx(distance, abs=1e-9)


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -math.pi / 2])
@pytest.mark.parametrize("speed", [1.0, 4.0, 30.0])
def test_left_steering_turns_left_in_all_headings(yaw: float, speed: float) -> None:
    bodies = drive(Body(0.0, 0.0, yaw, speed), steer(0.03), 2.0)
    yaws = [body.yaw for body in bodies]
    assert all(later > earlier for earlier, later in pairwise(yaws[1:]))
    last = bodies[-1]
    assert last.yaw_rate > 0.0
    assert -last.east * math.sin(yaw) + last.north * math.cos(yaw) > 0.0


@given(
    speed=st.floats(0.0, 35.0), yaw=st.floats(-3.0, 3.0), turned=st.floats(-3.0, 3.0),
    steering=st.floats(-0.5, 0.5), acceleration=st.floats(-4.0, 2.0),
)  # fmt: skip
@examples(8, 40)
def test_mirror_symmetry_and_rotation_invariance(
    speed: float, yaw: float, turned: float, steering: float, acceleration: float
) -> None:
    command = Actuation(steering, acceleration)
    moved = advance(Body(0.0, 0.0, yaw, speed, steering=0.1 * steering), command, 0.3, CAR)
    mirrored = advance(
        Body(0.0, 0.0, -yaw, speed, steering=-0.1 * steering),
        Actuation(-steering, acceleration),
        *(0.3, CAR),
    )
    assert (mirrored.east, -mirrored.north, -mirrored.yaw) == pytest.approx(
        (moved.east, moved.north, moved.yaw), abs=1e-12
    )
    assert -mirrored.yaw_rate == pytest.approx(moved.yaw_rate, abs=1e-12)
    rotated = advance(
        Body(0.0, 0.0, yaw + turned, speed, steering=0.1 * steering), command, 0.3, CAR
    )
    cos, sin = math.cos(turned), math.sin(turned)
    assert rotated.east == pytest.approx(cos * moved.east - sin * moved.north, abs=1e-9)
    assert rotated.north == pytest.approx(sin * moved.east + cos * moved.north, abs=1e-9)
    assert astuple(replace(rotated, east=0.0, north=0.0, yaw=0.0)) == pytest.approx(
        astuple(replace(moved, east=0.0, north=0.0, yaw=0.0)), abs=1e-9
    )


@pytest.mark.parametrize("acceleration", [0.5, 2.0, -0.5, -3.0])
def test_speed_ramps_pass_walking_pace_without_a_jump(acceleration: float) -> None:
    """Yaw rate follows the steady state, and its change per tick has no spike."""
    start = 0.0 if acceleration > 0.0 else 4.0
    bodies = drive(
        Body(0.0, 0.0, 0.0, start),
        lambda t: Actuation(0.2 * math.sin(2.0 * t), acceleration),
        4.0 / abs(acceleration),
    )
    assert min(b.speed for b in bodies) < WALKING_PACE < max(b.speed for b in bodies)
    lag = 0.006  # s: the tyres' time constant at walking pace, plus a margin
    for body in bodies:
        if body.speed < 2.5:
            rate = abs(body.steering_rate) * body.speed + abs(body.steering * acceleration)
            behind = abs(body.yaw_rate - steady_yaw_rate(body.speed, body.steering))
            assert behind < lag * rate / CAR.wheelbase + 1e-3
    changes = np.diff([body.yaw_rate for body in bodies])
    assert np.max(np.abs(np.diff(changes))) < 0.01


def test_slow_car_is_the_kinematic_single_track_model() -> None:
    speed, steering = 0.2, 0.3
    body = drive(Body(0.0, 0.0, 0.0, speed), steer(steering), 3.0)[-1]
    assert body.yaw_rate == pytest.approx(speed * steering / CAR.wheelbase, rel=1e-5)
    # The rear axle does not slip: its lateral speed is zero.
    sideways = body.lateral_speed - CAR.rear_axle_distance * body.yaw_rate
    assert abs(sideways) < 1e-5


def test_wheels_turn_for_the_rest_of_the_span_after_a_stop() -> None:
    """The steering actuation does not depend on speed."""
    command = Actuation(0.3, -5.0)
    stopped = advance(Body(0.0, 0.0, 0.0, 0.25), command, 0.1, CAR)
    parked = advance(Body(0.0, 0.0, 0.0, 0.0), command, 0.1, CAR)
    assert stopped.steering == pytest.approx(parked.steering, rel=1e-6)


@given(
    speed=st.floats(0.0, 35.0), steering=st.floats(-0.5, 0.5), acceleration=st.floats(-5.0, 2.0),
    share=st.floats(0.1, 0.9),
)  # fmt: skip
@examples(8, 40)
def test_two_successive_spans_equal_one(
    speed: float, steering: float, acceleration: float, share: float
) -> None:
    command, body = Actuation(steering, acceleration), Body(0.0, 0.0, 0.0, speed)
    once = advance(body, command, 0.05, CAR)
    part = advance(body, command, 0.05 * share, CAR)
    twice = advance(part, command, 0.05 - 0.05 * share, CAR)
    # For a full steering step at rest, 5e-5 is the integration error.
    assert astuple(twice)[:4] == pytest.approx(astuple(once)[:4], abs=5e-5)
    assert twice.speed >= 0.0


@pytest.mark.parametrize("requested", [0.6, -0.6, 5.0])
def test_steering_stops_at_its_limit(requested: float) -> None:
    limit = CAR.steering_limit
    bodies = drive(Body(0.0, 0.0, 0.0, 5.0), steer(requested), 1.0)
    assert all(abs(body.steering) <= limit for body in bodies)
    assert bodies[-1].steering == pytest.approx(math.copysign(limit, requested), rel=1e-3)
    assert bodies == drive(Body(0.0, 0.0, 0.0, 5.0), steer(math.copysign(limit, requested)), 1.0)
    back = drive(bodies[-1], steer(0.0), 1.0)[-1]
    assert abs(back.steering) < 1e-3


@pytest.mark.parametrize(
    ("command", "span"),
    [
        (Actuation(math.nan, 0.0), 0.02),
        (Actuation(0.0, math.inf), 0.02),
        (Actuation(0.0, 0.0), -0.01),
        (Actuation(0.0, 0.0), math.nan),
    ],
)
def test_invalid_commands_and_spans_are_rejected(command: Actuation, span: float) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        advance(Body(0.0, 0.0, 0.0, 10.0), command, span, CAR)


@pytest.mark.parametrize("tyres", ["linear", "brush"])
@pytest.mark.parametrize("speed", [0.0, 4.0, 25.0])
def test_the_steering_rate_is_limited(tyres: TyreModel, speed: float) -> None:
    slow = replace(CAR, tyres=tyres, steering_rate_limit=0.4)
    bodies = drive(Body(0.0, 0.0, 0.0, speed), steer(0.3), 1.5, car=slow)
    assert max(abs(body.steering_rate) for body in bodies) == 0.4
    steps = [after.steering - before.steering for before, after in pairwise(bodies)]
    assert max(map(abs, steps)) < 0.4 * TICK * 1.01
    assert bodies[-1].steering == pytest.approx(0.3, abs=0.002)


@pytest.mark.parametrize("speed", [0.5, 1.99, 2.0, 10.0, 30.0])
def test_gentle_driving_is_the_same_on_both_tyre_models(speed: float) -> None:
    brush = replace(CAR, tyres="brush")
    linear = drive(Body(0.0, 0.0, 0.0, speed), steer(0.002), 3.0)[-1]
    other = drive(Body(0.0, 0.0, 0.0, speed), steer(0.002), 3.0, car=brush)[-1]
    assert apart(linear, other) < 0.005 * linear.distance * linear.yaw + 1e-6
    assert other.yaw_rate == pytest.approx(linear.yaw_rate, rel=0.01)
    assert other.lateral_speed == pytest.approx(linear.lateral_speed, abs=2e-3)


def test_equations_agree_on_both_sides_of_walking_pace() -> None:
    turning = Body(0.0, 0.0, 0.0, WALKING_PACE, 0.3, 0.4, 0.2, 0.5)
    below = replace(turning, speed=WALKING_PACE - 1e-9)
    command = Actuation(-0.1, 0.0)
    left, right = advance(below, command, 0.02, CAR), advance(turning, command, 0.02, CAR)
    assert astuple(left) == pytest.approx(astuple(right), abs=1e-8)


def test_an_unreached_rate_limit_changes_no_bit() -> None:
    """Compares an infinite limit with one that a lane change does not reach."""
    free = drive(Body(0.0, 0.0, 0.0, 30.0), lane_change, 5.0)
    limited = replace(CAR, steering_rate_limit=5.0)
    assert drive(Body(0.0, 0.0, 0.0, 30.0), lane_change, 5.0, car=limited) == free
