"""The car on saturating tyres, against closed forms, energy and a second integrator."""

import math
from collections.abc import Callable
from dataclasses import astuple, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tests.made.examples import examples
from tests.made.vehicles.driving import TICK, advance, drive, steer
from vehicles.car.dynamics import Actuation, Body, TyreUse, tyre_use
from vehicles.car.parameters import LINCOLN_MKZ, VehicleParameters
from vehicles.car.tyres import GRAVITY, WALKING_PACE, axle_loads

CAR = replace(LINCOLN_MKZ, tyres="brush", steering_rate_limit=0.59)
MAX_ACCELERATION = CAR.friction * GRAVITY
"""Friction limit of the acceleration (m/s²)."""
COMMANDS = st.lists(
    st.tuples(st.floats(-0.54, 0.54), st.floats(-10.0, 5.0)), min_size=1, max_size=60
)


def use(body: Body, acceleration: float = 0.0, car: VehicleParameters = CAR) -> TyreUse:
    return tyre_use(body, acceleration, car)


def energy(body: Body) -> float:
    """Kinetic energy per mass, including rotation."""
    turning = CAR.yaw_inertia / CAR.mass * body.yaw_rate**2
    return 0.5 * (body.speed**2 + body.lateral_speed**2 + turning)


def steady(speed: float, share: float) -> tuple[Body, float]:
    """Closed form of steady cornering at a share of the friction: body, and steering angle (rad).

    F = capacity (1 - (1 - x)³), so s = 3 capacity (1 - (1 - share)^(1/3)) / C on either axle, since
    both use the same share of their load.
    """
    yaw_rate = share * MAX_ACCELERATION / speed
    loads = axle_loads(CAR)
    x = 1.0 - (1.0 - share) ** (1.0 / 3.0)
    front = 3.0 * CAR.friction * loads[0] * x / CAR.front_cornering_stiffness
    rear = 3.0 * CAR.friction * loads[1] * x / CAR.rear_cornering_stiffness
    lateral = CAR.rear_axle_distance * yaw_rate - rear * speed
    steering = (lateral + CAR.front_axle_distance * yaw_rate) / speed + front
    body = Body(0.0, 0.0, 0.0, speed, lateral, yaw_rate, steering)
    return body, steering


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
@pytest.mark.parametrize("share", [0.05, 0.3, 0.6, 0.9, 0.99])
def test_steady_cornering_matches_the_closed_form_of_the_brush_model(
    speed: float, share: float
) -> None:
    body, steering = steady(speed, share)
    usage = use(body)
    assert usage.friction_share == pytest.approx(share, rel=1e-9)
    assert usage.lateral_acceleration == pytest.approx(share * MAX_ACCELERATION, rel=1e-9)
    # Drive must compensate the drag of the slip, or the car slows down.
    lost = (
        -body.yaw_rate * body.lateral_speed
        + usage.lateral_acceleration * (CAR.rear_axle_distance / CAR.wheelbase) * steering
    )
    assert 0.0 < lost < 0.1 * MAX_ACCELERATION
    after = advance(
        body, Actuation(steering, 0.0), 1e-4, replace(CAR, steering_rate_limit=math.inf)
    )
    assert (after.speed - speed) / 1e-4 == pytest.approx(-lost, abs=0.01)
    assert after.lateral_speed == pytest.approx(body.lateral_speed, abs=2e-6)
    assert after.yaw_rate == pytest.approx(body.yaw_rate, abs=2e-6)


@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_small_accelerations_have_the_understeer_of_linear_tyres(speed: float) -> None:
    """δ = L κ + K_sg v² κ of eq. (6), as the curvature goes to zero."""
    off = []
    for share in (1e-3, 1e-4):
        body, steering = steady(speed, share)
        curvature = body.yaw_rate / speed
        gradient = (steering / curvature - CAR.wheelbase) / speed**2
        off.append(abs(gradient / CAR.steer_gradient - 1.0))
    assert off[1] < 1e-3
    assert off[1] == pytest.approx(off[0] / 10.0, rel=0.2)


def test_lateral_acceleration_reaches_but_does_not_exceed_friction() -> None:
    most = 0.0
    for steering in (0.05, 0.1, 0.2, 0.54):
        for body in drive(Body(0.0, 0.0, 0.0, 20.0), steer(steering), 2.0, car=CAR):
            most = max(most, abs(use(body).lateral_acceleration))
    assert 0.97 * MAX_ACCELERATION < most <= MAX_ACCELERATION * (1.0 + 1e-12)


@pytest.mark.parametrize("braking", [0.0, 3.0, 6.0, 8.0])
def test_braking_in_a_turn_shares_the_friction(braking: float) -> None:
    sliding = Body(0.0, 0.0, 0.0, 20.0, steering=0.5)
    usage = use(sliding, -braking)
    front = axle_loads(CAR)[0] / (CAR.mass * GRAVITY)
    assert usage.lateral_acceleration == pytest.approx(
        front * math.sqrt(MAX_ACCELERATION**2 - braking**2)
    )
    assert usage.friction_share == pytest.approx(1.0)


def test_braking_reaches_but_does_not_exceed_friction() -> None:
    for requested in (5.0, 8.0, 12.0, 30.0):
        bodies = drive(Body(0.0, 0.0, 0.0, 20.0), steer(0.0, -requested), 1.0, car=CAR)
        assert 20.0 - bodies[-1].speed == pytest.approx(min(requested, MAX_ACCELERATION), rel=1e-9)
        assert use(bodies[-1], -requested).friction_share == pytest.approx(
            min(requested / MAX_ACCELERATION, 1.0)
        )


@given(commands=COMMANDS, speed=st.floats(0.0, 40.0), lateral=st.floats(-5.0, 5.0),
       yaw_rate=st.floats(-2.0, 2.0))  # fmt: skip
@examples(10, 60)
def test_friction_is_never_exceeded(
    commands: list[tuple[float, float]], speed: float, lateral: float, yaw_rate: float
) -> None:
    body = Body(0.0, 0.0, 0.0, speed, lateral, yaw_rate)
    for steering, acceleration in commands:
        after = advance(body, Actuation(steering, acceleration), TICK, CAR)
        gain = np.subtract(ground_velocity(after), ground_velocity(body))
        if after.speed > 0.0:  # else the bound against rolling backwards acts as well
            # The model's front force also has a component along the body.
            assert np.hypot(*gain) <= MAX_ACCELERATION * TICK * 1.15
        assert use(after, acceleration).friction_share <= 1.0 + 1e-12
        assert abs(use(after, acceleration).lateral_acceleration) <= MAX_ACCELERATION * (
            1.0 + 1e-12
        )
        assert after.speed >= 0.0
        assert abs(after.steering_rate) <= CAR.steering_rate_limit
        assert abs(after.steering) <= CAR.steering_limit
        body = after


def ground_velocity(body: Body) -> tuple[float, float]:
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    return (
        body.speed * cos - body.lateral_speed * sin, body.speed * sin + body.lateral_speed * cos
    )  # fmt: skip


@given(speed=st.floats(0.0, 40.0), lateral=st.floats(-20.0, 20.0), yaw_rate=st.floats(-4.0, 4.0),
       commands=COMMANDS)  # fmt: skip
@examples(10, 60)
def test_without_drive_the_energy_never_grows(
    speed: float, lateral: float, yaw_rate: float, commands: list[tuple[float, float]]
) -> None:
    body = Body(0.0, 0.0, 0.0, speed, lateral, yaw_rate)
    for steering, acceleration in commands:
        after = advance(body, Actuation(steering, min(acceleration, 0.0)), TICK, CAR)
        assert energy(after) <= energy(body) * (1.0 + 1e-4) + 1e-4
        body = after


@given(commands=COMMANDS, speed=st.floats(0.0, 40.0))
@examples(8, 40)
def test_left_and_right_are_mirror_images(
    commands: list[tuple[float, float]], speed: float
) -> None:
    left = right = Body(0.0, 0.0, 0.0, speed)
    for steering, acceleration in commands:
        left = advance(left, Actuation(steering, acceleration), TICK, CAR)
        right = advance(right, Actuation(-steering, acceleration), TICK, CAR)
    mirrored = replace(
        right, north=-right.north, yaw=-right.yaw, lateral_speed=-right.lateral_speed,
        yaw_rate=-right.yaw_rate, steering=-right.steering, steering_rate=-right.steering_rate,
    )  # fmt: skip
    assert astuple(mirrored) == pytest.approx(astuple(left), abs=1e-9)


def slope(_: float, state: np.ndarray, command: Actuation, held: bool) -> list[float]:
    """Independent implementation of the equations; `held` at the rate limit."""
    _, _, yaw, v, y, r, s, w, _ = state
    requested = command.acceleration
    given_ = (
        float(np.clip(requested, -MAX_ACCELERATION, MAX_ACCELERATION))
        if v > 0.0 or requested > 0.0
        else 0.0
    )
    left = math.sqrt(max(CAR.friction**2 - (given_ / GRAVITY) ** 2, 0.0))
    rolling = max(v, WALKING_PACE)
    front_slip = (y + CAR.front_axle_distance * r - v * s) / rolling
    rear_slip = (y - CAR.rear_axle_distance * r) / rolling
    loads = axle_loads(CAR)
    front = cubic(front_slip, CAR.front_cornering_stiffness, left * loads[0])
    rear = cubic(rear_slip, CAR.rear_cornering_stiffness, left * loads[1])
    turn = CAR.front_axle_distance * front - CAR.rear_axle_distance * rear
    cos, sin = math.cos(yaw), math.sin(yaw)
    return [
        *(v * cos - y * sin, v * sin + y * cos, r),
        *(given_ + r * y - front * s / CAR.mass, (front + rear) / CAR.mass - r * v),
        *(
            turn / CAR.yaw_inertia,
            w,
            0.0 if held else steering_acceleration(state, command),
            math.hypot(v, y),
        ),
    ]


def cubic(slip: float, stiffness: float, top: float) -> float:
    """Brush force in another form, top (1 - (1 - x)³)."""
    x = min(stiffness * abs(slip) / (3.0 * top), 1.0) if top > 0.0 else 1.0
    return -math.copysign(top * (1.0 - (1.0 - x) ** 3), slip)


def steering_acceleration(state: np.ndarray, command: Actuation) -> float:
    """Change of the steering rate by eq. (4)."""
    frequency, damping = CAR.steering_frequency, CAR.steering_damping
    return float(frequency * (frequency * (command.steering - state[6]) - 2.0 * damping * state[7]))


def exactly(body: Body, command: Actuation) -> np.ndarray:
    """One span by an adaptive solver, interrupted where the steering rate reaches its limit."""
    state = np.array([
        *(body.east, body.north, body.yaw, body.speed, body.lateral_speed, body.yaw_rate),
        *(body.steering, body.steering_rate, body.distance),
    ])  # fmt: skip
    now, limit = 0.0, CAR.steering_rate_limit
    while now < TICK - 1e-12:
        held = (
            abs(state[7]) >= limit - 1e-9 and steering_acceleration(state, command) * state[7] > 0.0
        )
        side = math.copysign(1.0, state[7])

        def change(
            _: float, at: np.ndarray, *_args: object, side: float = side, held: bool = held
        ) -> float:
            return side * steering_acceleration(at, command) if held else abs(at[7]) - limit

        change.terminal = True  # type: ignore[attr-defined]
        change.direction = -1.0 if held else 1.0  # type: ignore[attr-defined]
        done = solve_ivp(
            slope, (now, TICK), state, "RK45", args=(command, held), rtol=1e-8, atol=1e-9,
            events=change,
        )  # fmt: skip
        now, state = done.t[-1], done.y[:, -1]
    return state


def hard_lane_change(t: float) -> Actuation:
    return Actuation(0.25 * math.copysign(1.0, math.sin(3.0 * t)), -4.0 * (t > 1.0))


def wheels_turned_and_brakes(t: float) -> Actuation:
    return Actuation(0.4, -8.0 if t > 0.5 else 2.0)


def sweeping(t: float) -> Actuation:
    return Actuation(0.12 * math.sin(4.0 * t), 2.0 * math.cos(t))


@pytest.mark.parametrize("manoeuvre", [hard_lane_change, wheels_turned_and_brakes, sweeping])
@pytest.mark.parametrize("speed", [35.0, 12.0])
def test_every_span_agrees_with_an_adaptive_solver(
    manoeuvre: Callable[[float], Actuation], speed: float
) -> None:
    body = Body(0.0, 0.0, 0.3, speed)
    for k in range(50):
        command = manoeuvre(k * 2 * TICK)
        exact = exactly(body, command)
        body = advance(body, command, TICK, CAR)
        if exact[3] < 0.2:
            break  # the solver would roll backwards from rest
        assert math.dist((body.east, body.north), exact[:2]) < 1e-4
        assert body.yaw == pytest.approx(exact[2], abs=1e-4)
        moving = (body.speed, body.lateral_speed, body.yaw_rate)
        assert moving == pytest.approx(tuple(exact[3:6]), abs=0.01)
        assert body.steering == pytest.approx(exact[6], abs=5e-4)


def test_it_settles_at_the_closed_form() -> None:
    body, steering = steady(15.0, 0.7)
    settled = drive(replace(body, lateral_speed=0.0, yaw_rate=0.0), steer(steering), 3.0, car=CAR)[
        -1
    ]
    again = steady(settled.speed, settled.yaw_rate * settled.speed / MAX_ACCELERATION)
    # The speed has decreased slightly, so the state is not exactly steady.
    assert again[1] == pytest.approx(steering, rel=0.02)
    assert settled.lateral_speed == pytest.approx(again[0].lateral_speed, abs=0.02)
