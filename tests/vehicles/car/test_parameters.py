from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.car.parameters import LINCOLN_MKZ, Loading, VehicleParameters, loaded


def steady_state(car: VehicleParameters, speed: float) -> tuple[float, float]:
    """Lateral speed and yaw rate per steering angle: eqs. (1), (2) with derivatives of zero."""
    front, rear = car.front_cornering_stiffness, car.rear_cornering_stiffness
    a, b = car.front_axle_distance, car.rear_axle_distance
    matrix = [
        [(front + rear) / speed, (a * front - b * rear) / speed + car.mass * speed],
        [(a * front - b * rear) / speed, (a * a * front + b * b * rear) / speed],
    ]
    lateral, yaw_rate = np.linalg.solve(matrix, [front, a * front])
    return float(lateral), float(yaw_rate)


def test_wheelbase_and_steer_gradient_of_table_i() -> None:
    assert LINCOLN_MKZ.wheelbase == pytest.approx(2.85)
    assert LINCOLN_MKZ.steer_gradient == pytest.approx(4.216e-4, rel=1e-4)


@given(speed=st.floats(0.5, 45.0))
def test_gradient_and_slip_are_the_steady_state_of_the_equations(speed: float) -> None:
    for car in (LINCOLN_MKZ, loaded(LINCOLN_MKZ, Loading(front_passengers=1, rear_passengers=3))):
        lateral, yaw_rate = steady_state(car, speed)
        assert speed / yaw_rate == pytest.approx(
            car.wheelbase + car.steer_gradient * speed**2, rel=1e-9
        )
        assert lateral / yaw_rate == pytest.approx(car.steady_slip_per_curvature(speed), abs=1e-9)


def test_at_walking_pace_the_slip_is_the_rear_axle_s_distance() -> None:
    assert LINCOLN_MKZ.steady_slip_per_curvature(0.0) == LINCOLN_MKZ.rear_axle_distance


def test_load_adds_mass_and_inertia_as_in_the_paper() -> None:
    car = loaded(LINCOLN_MKZ, Loading(front_passengers=1, rear_passengers=3))
    assert car.mass == 1896.0 + 4 * 70.0 + 4 * 50.0
    inertia = 3803.0 + 70 * 1.2682**2 + 3 * 70 * 1.5818**2 + 4 * 50 * (1.5818 + 0.5) ** 2
    assert car.yaw_inertia == pytest.approx(inertia)
    assert replace(car, mass=1896.0, yaw_inertia=3803.0) == LINCOLN_MKZ
