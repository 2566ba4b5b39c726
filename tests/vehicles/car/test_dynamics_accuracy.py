import math
from dataclasses import astuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from tests.made.vehicles.driving import TICK, advance, apart, drive, lane_change, steer
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR


def lateral_matrix(speed: float) -> np.ndarray:
    """Eqs. (1), (2), (4) as a linear system in (v_y, r, delta, delta', command)."""
    m, i = CAR.mass, CAR.yaw_inertia
    cf, cr = CAR.front_cornering_stiffness, CAR.rear_cornering_stiffness
    a, b = CAR.front_axle_distance, CAR.rear_axle_distance
    w, z = CAR.steering_frequency, CAR.steering_damping
    c = a * cf - b * cr
    return np.array(
        [
            [-(cf + cr) / (m * speed), -c / (m * speed) - speed, cf / m, 0.0, 0.0],
            [-c / (i * speed), -(a * a * cf + b * b * cr) / (i * speed), a * cf / i, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, -w * w, -2.0 * z * w, w * w],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )


@pytest.mark.parametrize("speed", [2.0, 3.0, 10.0, 30.0, 40.0])
def test_at_constant_speed_it_is_the_matrix_exponential(speed: float) -> None:
    bodies = drive(Body(0.0, 0.0, 0.0, speed), steer(0.05), 1.0)
    exact = expm(lateral_matrix(speed) * TICK)
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.05])
    for body in bodies[1:]:
        state = exact @ state
        assert (body.lateral_speed, body.yaw_rate) == pytest.approx(tuple(state[:2]), abs=4e-4)
        assert body.steering == pytest.approx(state[2], abs=2e-5)
        assert body.steering_rate == pytest.approx(state[3], abs=4e-4)


@pytest.mark.parametrize(("speed", "acceleration"), [(30.0, 0.0), (30.0, -3.0), (5.0, 2.0)])
def test_path_agrees_with_an_adaptive_solver_within_five_micrometres(
    speed: float, acceleration: float
) -> None:
    def slope(_: float, y: np.ndarray, command: float) -> list[float]:
        matrix = lateral_matrix(y[3])
        lateral, yaw_rate, steering, rate, _ = matrix @ [y[4], y[5], y[6], y[7], command]
        cos, sin = math.cos(y[2]), math.sin(y[2])
        return [
            *(y[3] * cos - y[4] * sin, y[3] * sin + y[4] * cos, y[5], acceleration),
            *(lateral, yaw_rate, steering, rate, math.hypot(y[3], y[4])),
        ]

    body = Body(0.0, 0.0, 0.3, speed)
    exact = np.array(astuple(body))
    for k in range(200):
        command = Actuation(lane_change(k * TICK).steering, acceleration)
        body = advance(body, command, TICK, CAR)
        exact = solve_ivp(
            slope, (0.0, TICK), exact, "DOP853", args=(command.steering,), rtol=1e-11, atol=1e-12
        ).y[:, -1]
        assert math.hypot(body.east - exact[0], body.north - exact[1]) < 5e-6
    assert body.speed == pytest.approx(exact[3])
    assert body.distance == pytest.approx(exact[8], abs=1e-5)


@pytest.mark.parametrize("speed", [40.0, 30.0, 20.0, 8.0, 3.0])
def test_shorter_steps_move_the_lane_change_by_less_than_five_micrometres(
    speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = Body(0.0, 0.0, 0.0, speed)
    shipped = drive(start, lane_change, 5.0)
    monkeypatch.setattr("vehicles.car.dynamics.STEP_PER_RATE", 0.05)
    assert max(map(apart, shipped, drive(start, lane_change, 5.0))) < 5e-6
