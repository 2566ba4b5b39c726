import numpy as np
import pytest
from hypothesis import given

from tests.made.examples import examples
from tests.made.vehicles.theory.error_model import curvature_input, curvature_rate_input
from tests.made.vehicles.theory.random_cars import CAR, CARS, GAINS, SPEEDS
from vehicles.car.parameters import (
    NOMINAL_GAINS,
    Gains,
    Loading,
    VehicleParameters,
    loaded,
    loaded_with_moved_centre,
)
from vehicles.theory.linear_model import (
    characteristic_polynomial,
    closed_loop,
    closed_loop_at,
    feedback_numerator,
    feedback_row,
    handling_polynomial,
    lateral_numerator,
    open_loop,
    speed_change_matrix,
    steady_cornering,
    steering_input,
)

Array = np.ndarray


@examples(10, 60)
@given(CARS, GAINS, SPEEDS)
def test_polynomial_is_the_determinant(car: VehicleParameters, gains: Gains, speed: float) -> None:
    polynomial = characteristic_polynomial(car, gains, speed)
    matrix = closed_loop_at(car, gains, speed)
    for s in (0.7, -1.3, 2.0 + 3.0j, -4.0 + 15.0j, 30.0j):
        terms = np.abs(polynomial) * abs(s) ** np.arange(6, -1, -1)
        leading = car.mass * car.yaw_inertia / car.steering_frequency**2
        determinant = leading * np.linalg.det(s * np.eye(6) - matrix)
        assert abs(np.polyval(polynomial, s) - determinant) < 1e-9 * terms.sum()


@given(CARS, GAINS, SPEEDS)
def test_coefficients_as_printed(p: VehicleParameters, gains: Gains, v: float) -> None:
    """A6...A0 as the paper prints them; they belong to Delta over w_n squared."""
    m, iz, cf, cr = p.mass, p.yaw_inertia, p.front_cornering_stiffness, p.rear_cornering_stiffness
    a, b, zeta, wn = (
        *(p.front_axle_distance, p.rear_axle_distance),
        *(p.steering_damping, p.steering_frequency),
    )
    ke, kt, kw = gains
    damp = cf * (iz + a * a * m) + cr * (iz + b * b * m)
    stiff = (a + b) ** 2 * cf * cr / v**2 - m * (a * cf - b * cr)
    printed = [
        iz * m / wn**2,
        2 * iz * m * zeta / wn + damp / (v * wn**2),
        2 * zeta * damp / (v * wn) + stiff / wn**2 + m * iz,
        2 * zeta / wn * stiff + damp / v + cf * m * a * kw,
        stiff + cf * iz * ke + cf * cr * (a + b) / v * kw + m * a * cf * kt,
        cf * cr * (a + b) / v * (b * ke + kt),
        cf * cr * (a + b) * ke,
    ]
    assert characteristic_polynomial(p, gains, v) == pytest.approx(np.array(printed), rel=1e-12)


def _drive(speed_change: float, with_speed_term: bool) -> tuple[Array, Array]:
    """Errors on a bending path while braking: from eqs. (1), (2), and from the error model."""
    p, gains = CAR, NOMINAL_GAINS
    cf, cr, a, b = (
        *(p.front_cornering_stiffness, p.rear_cornering_stiffness),
        *(p.front_axle_distance, p.rear_axle_distance),
    )
    constant, inverse_speed = closed_loop(p, gains)
    entering = speed_change_matrix() * (speed_change if with_speed_term else 0.0)

    def curvature(t: float) -> tuple[float, float]:
        return 2e-3 * np.sin(2.0 * t), 4e-3 * np.cos(2.0 * t)

    def both(t: float, state: Array) -> Array:
        e, theta, side, yaw_rate, steering, steering_rate = state[:6]
        v = 25.0 + speed_change * t
        kappa, kappa_rate = curvature(t)
        forces = (cf * (steering - (side + a * yaw_rate) / v), -cr * (side - b * yaw_rate) / v)
        errors = np.array([e, theta, side + v * theta, yaw_rate - v * kappa, 0.0, 0.0])
        feedforward = (p.wheelbase + p.steer_gradient * v * v) * kappa
        command = feedforward - feedback_row(gains) @ errors
        body = [
            *errors[2:4],
            (forces[0] + forces[1]) / p.mass - v * yaw_rate,
            (a * forces[0] - b * forces[1]) / p.yaw_inertia,
            steering_rate,
            p.steering_frequency**2 * (command - steering)
            - 2.0 * p.steering_damping * p.steering_frequency * steering_rate,
        ]
        z = state[6:]
        # theta_R' = v kappa changes with the speed as well as with the curvature
        turning = kappa_rate + speed_change * kappa / v
        model = (constant + inverse_speed / v + entering) @ z
        model += curvature_input(p, v) * kappa + curvature_rate_input(v) * turning
        return np.array([*body, *model])

    state, step = np.zeros(12), 2e-3
    side = 0.1
    state[2], state[8], state[9] = side, side, 0.0
    state[9] = -25.0 * curvature(0.0)[0]
    for k in range(1000):
        t = k * step
        k1 = both(t, state)
        k2 = both(t + step / 2, state + step / 2 * k1)
        k3 = both(t + step / 2, state + step / 2 * k2)
        k4 = both(t + step, state + step * k3)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state[:2], state[6:8]


@pytest.mark.parametrize("speed_change", [0.0, -6.0, 4.0])
def test_error_model_is_the_car_in_the_path_frame(speed_change: float) -> None:
    body, model = _drive(speed_change, with_speed_term=True)
    assert model == pytest.approx(body, rel=1e-6)
    assert np.abs(body).max() > 1e-3


def test_left_is_positive() -> None:
    constant, inverse_speed = open_loop(CAR)
    z = np.zeros(6)
    z[4] = 0.01  # steered left
    rates = (constant + inverse_speed / 20.0) @ z
    assert rates[2] > 0.0
    assert rates[3] > 0.0
    z = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # left of the path: steer right
    assert (closed_loop_at(CAR, NOMINAL_GAINS, 20.0) @ z)[5] < 0.0
    assert curvature_input(CAR, 20.0)[5] > 0.0  # feedforward into a left bend


@examples(8, 40)
@given(CARS, CARS, SPEEDS)
def test_steady_cornering_is_the_equilibrium(
    car: VehicleParameters, known: VehicleParameters, speed: float
) -> None:
    curvature = 1.0 / 300.0
    matrix = closed_loop_at(car, NOMINAL_GAINS, speed)
    for assumed in (None, known):
        rest = np.linalg.solve(matrix, -curvature_input(car, speed, assumed) * curvature)
        lateral, heading = steady_cornering(car, NOMINAL_GAINS, speed, curvature, assumed)
        assert rest[:2] == pytest.approx([lateral, heading], rel=1e-6, abs=1e-9)
        assert rest[2:4] == pytest.approx([0.0, 0.0], abs=1e-9)


@given(CARS, GAINS, SPEEDS)
def test_transfer_functions_from_the_matrices(
    car: VehicleParameters, gains: Gains, speed: float
) -> None:
    constant, inverse_speed = open_loop(car)
    matrix = (constant + inverse_speed / speed)[:4, :4]
    column = constant[:4, 4]
    for s in (1.0j, 5.0j, 2.0 + 1.0j):
        state = np.linalg.solve(s * np.eye(4) - matrix, column)
        open_polynomial = s**2 * np.polyval(handling_polynomial(car, speed), s)
        lateral = np.polyval(lateral_numerator(car, speed), s) / open_polynomial
        fed_back = np.polyval(feedback_numerator(car, gains, speed), s) / open_polynomial
        assert state[0] == pytest.approx(lateral, rel=1e-8)
        assert feedback_row(gains)[:4] @ state == pytest.approx(fed_back, rel=1e-7, abs=1e-9)
    assert steering_input(car)[5] == car.steering_frequency**2


def test_moved_centre_by_summing_masses() -> None:
    load = Loading(front_passengers=1, rear_passengers=2)
    a, b = CAR.front_axle_distance, CAR.rear_axle_distance
    points = [(CAR.mass, 0.0), (70.0, a), (140.0, -b), (150.0, -(b + 0.5))]
    total = sum(m for m, _ in points)
    centre = sum(m * x for m, x in points) / total
    inertia = CAR.yaw_inertia + sum(m * (x - centre) ** 2 for m, x in points)
    moved = loaded_with_moved_centre(CAR, load)
    assert moved.mass == pytest.approx(total)
    assert moved.front_axle_distance == pytest.approx(a - centre)
    assert moved.wheelbase == pytest.approx(CAR.wheelbase)
    assert moved.yaw_inertia == pytest.approx(inertia)
    assert loaded_with_moved_centre(CAR, Loading()) == CAR
    full = Loading(front_passengers=1, rear_passengers=3)
    assert loaded_with_moved_centre(CAR, full).steer_gradient < 0.0  # tail-heavy: oversteers
    assert loaded(CAR, full).steer_gradient > 0.0
