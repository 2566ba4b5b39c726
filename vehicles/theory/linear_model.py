"""The car's motion relative to its trajectory as a linear system (paper, Sections II and III-F).

State z = (e_lat, theta~, their rates, steering angle, steering rate) in m, rad, s; left positive.
With gamma = 1/v the matrix is A(gamma) = A0 + gamma A1. Derived from eqs. (1), (2) with
v_y = e' - v theta~ and yaw rate = theta~' + v kappa. Differences from the paper's text:

- The state equation lacks M^-1 before L, C_0, B and F (Section IV-A). The second-order form (3) has
  the mass matrix and is correct, units included: m v² and a C_f - b C_r are both N m per radian.
- Eq. (3) holds on arcs only. Where curvature changes, theta~'' also contains -v kappa'.
- Eq. (3) holds at constant speed only. Since e' = v_y + v theta~, a changing speed adds v' theta~
  to e'' (`speed_change_matrix`), which A(gamma(t)) of Proposition 1 omits.
- The coefficients A6...A0 are those of Delta(s, K) / w_n²: the polynomial of the equation before
  them is w_n² times as large. The roots are the same.
- Delta_o(s) has a double root at the origin, so its roots are never all in the open left
  half-plane; the figure of roots over masses must show Delta(s, K).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters

Array = NDArray[np.float64]


def open_loop(parameters: VehicleParameters) -> tuple[Array, Array]:
    """A0, A1 of the car without feedback: z' = (A0 + A1 / v) z + steering_input * delta_c + ...

    Eq. (3) with eq. (4) and M^-1 in place; shapes (6, 6).
    """
    front, rear = parameters.front_cornering_stiffness, parameters.rear_cornering_stiffness
    a, b = parameters.front_axle_distance, parameters.rear_axle_distance
    total, moment = front + rear, a * front - b * rear
    damping = a * a * front + b * b * rear
    inertia = np.array([parameters.mass, parameters.yaw_inertia])
    constant, inverse_speed = np.zeros((6, 6)), np.zeros((6, 6))
    constant[0, 2] = constant[1, 3] = constant[4, 5] = 1.0
    constant[2:4, 1] = np.array([total, moment]) / inertia
    constant[2:4, 4] = np.array([front, a * front]) / inertia
    inverse_speed[2, 2:4] = -np.array([total, moment]) / parameters.mass
    inverse_speed[3, 2:4] = -np.array([moment, damping]) / parameters.yaw_inertia
    constant[5, 4] = -(parameters.steering_frequency**2)
    constant[5, 5] = -2.0 * parameters.steering_damping * parameters.steering_frequency
    return constant, inverse_speed


def steering_input(parameters: VehicleParameters) -> Array:
    """Column by which the steering command delta_c (rad) enters z', from eq. (4); shape (6,)."""
    column = np.zeros(6)
    column[5] = parameters.steering_frequency**2
    return column


def feedback_row(gains: Gains) -> Array:
    """K in delta_fb = -K z: (k_e, k_theta, 0, k_omega, 0, 0), paper eq. (7)."""
    return np.array([gains.lateral, gains.heading, 0.0, gains.yaw_rate, 0.0, 0.0])


def closed_loop(parameters: VehicleParameters, gains: Gains) -> tuple[Array, Array]:
    """A0, A1 with feedback, A(gamma) = A0 + gamma A1 of Proposition 1, M^-1 in place; (6, 6)."""
    constant, inverse_speed = open_loop(parameters)
    feedback = np.outer(steering_input(parameters), feedback_row(gains))
    return constant - feedback, inverse_speed


def closed_loop_at(parameters: VehicleParameters, gains: Gains, speed: float) -> Array:
    """A(gamma) of Proposition 1 at gamma = 1 / `speed` (s/m), shape (6, 6)."""
    constant, inverse_speed = closed_loop(parameters, gains)
    return constant + inverse_speed / speed


def speed_change_matrix() -> Array:
    """E with z' = (A(1/v) + v' E) z while the speed changes at rate v' (m/s²): v' theta~ in e''."""
    matrix = np.zeros((6, 6))
    matrix[2, 1] = 1.0
    return matrix


def steady_cornering(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    curvature: float,
    assumed: VehicleParameters | None = None,
) -> tuple[float, float]:
    """Steady lateral error (m) and heading error (rad) on an arc, eqs. (3), (6), (7).

    The car has theta~ = -(b - m a v² / (L C_r)) kappa on an arc. The feedback of theta~ causes a
    steady e_lat, which is zero only if the slip is. With a feedforward for the parameters
    `assumed`, its error adds to it.
    """
    assumed = assumed or parameters
    surplus = (assumed.wheelbase - parameters.wheelbase) + speed * speed * (
        assumed.steer_gradient - parameters.steer_gradient
    )
    heading = -parameters.steady_slip_per_curvature(speed) * curvature
    return (surplus * curvature - gains.heading * heading) / gains.lateral, heading


def handling_polynomial(parameters: VehicleParameters, speed: float) -> Array:
    """R(s) in Delta_o(s) = s² R(s), the open loop without its double root at 0; shape (3,).

    Delta_o is defined in Section III-F, R in Section IV-B.
    """
    front, rear = parameters.front_cornering_stiffness, parameters.rear_cornering_stiffness
    a, b = parameters.front_axle_distance, parameters.rear_axle_distance
    mass, inertia = parameters.mass, parameters.yaw_inertia
    turning = (inertia + mass * a * a) * front + (inertia + mass * b * b) * rear
    stiffness = (parameters.wheelbase / speed) ** 2 * front * rear - mass * (a * front - b * rear)
    return np.array([mass * inertia, turning / speed, stiffness])


def lateral_numerator(parameters: VehicleParameters, speed: float) -> Array:
    """Numerator of e_lat / delta_f over Delta_o (paper, Section III-F); shape (3,)."""
    p = parameters
    stiffness = p.wheelbase * p.rear_cornering_stiffness
    damping = p.rear_axle_distance * stiffness / speed
    return p.front_cornering_stiffness * np.array([p.yaw_inertia, damping, stiffness])


def heading_numerator(parameters: VehicleParameters, speed: float) -> Array:
    """Numerator of theta~ / delta_f over Delta_o (paper, Section III-F); shape (3,)."""
    p = parameters
    damping = p.wheelbase * p.rear_cornering_stiffness / speed
    return p.front_cornering_stiffness * np.array([p.mass * p.front_axle_distance, damping, 0.0])


def feedback_numerator(parameters: VehicleParameters, gains: Gains, speed: float) -> Array:
    """N(s) of H(s) = N / Delta_o, from steering command to feedback; shape (4,), Section IV-B."""
    total = np.convolve([gains.yaw_rate, gains.heading], heading_numerator(parameters, speed))
    total[1:] += gains.lateral * lateral_numerator(parameters, speed)
    return np.asarray(total, dtype=np.float64)


def affine_coefficients(parameters: VehicleParameters, speed: float) -> tuple[Array, Array]:
    """Coefficients A6...A0 as constant + slopes @ (k_e, k_theta, k_omega); (7,) and (7, 3).

    Paper, Section III-F. A6 does not depend on the gains, so no root passes through infinity.
    """
    heading = heading_numerator(parameters, speed)
    frequency, damping = parameters.steering_frequency, parameters.steering_damping
    actuation = np.array([1.0 / frequency**2, 2.0 * damping / frequency, 1.0])
    constant, slopes = np.zeros(7), np.zeros((7, 3))
    constant[:5] = np.convolve(actuation, handling_polynomial(parameters, speed))
    slopes[4:, 0], slopes[4:, 1] = lateral_numerator(parameters, speed), heading
    slopes[3:6, 2] = heading
    return constant, slopes


def characteristic_polynomial(
    parameters: VehicleParameters, gains: Gains | Array, speed: float
) -> Array:
    """Delta(s, K) / w_n² = A6 s^6 + ... + A0, paper Section III-F; gains (..., 3) to (..., 7)."""
    constant, slopes = affine_coefficients(parameters, speed)
    return np.asarray(constant + np.asarray(gains, dtype=np.float64) @ slopes.T)


# ---- Transfer functions of lateral errors down the convoy, in closed form (Section IV-B)
#
# `propagation`, the paper's chain: feedback on x_i - x_(i-1), the difference of both vehicles'
# lateral offset and heading at one instant. The signal u_i = K x_i satisfies u_i = G u_(i-1) with
# G = H / (1 + H), and so does every component of x from the first follower on. Differences from the
# paper's text:
#
# - N(0) lacks the factor C_f of K(s): N(0) = C_f C_r (a + b) k_e. The sign is the same.
# - N(0)/R(0) > 0, and so |G| > 1 at low frequency, requires R(0) > 0. This is true at any speed for
#   an understeering car and below the critical speed for an oversteering car. "det M_0(s) = 0" must
#   refer to s = 0.
# - Any car amplifies at some frequency: with two integrators in the loop, Bode's integral of ln|G|
#   / w² over all frequencies is not negative.
# - |G| <= 1 is necessary, not sufficient: |G| is a lower bound of sigma_max.
#
# `trace_propagation`, closer to the emulator: a follower knows the path of its predecessor, not its
# heading at the same instant. Its reference is that path: lateral offset y, course y' / v,
# curvature y'' / v², with feedforward. The transfer function is from lateral offset to lateral
# offset at the same position on the road.
#
# With the lead's data and the weight alpha of the predecessor, either chain becomes
# y_i = F (alpha y_(i-1) + (1 - alpha) y_0), which contracts if alpha |F| < 1 at every frequency.


ComplexArray = NDArray[np.complex128]

SteeringModel = Literal["second order", "instantaneous"]  # Eq. (4), or H_a = 1


@dataclass(frozen=True, slots=True)
class Transfer:
    """A rational transfer function (G of Section IV-B); coefficients in descending powers of s."""

    numerator: Array
    denominator: Array

    def at(self, frequencies: Array) -> ComplexArray:
        """Value at j w for frequencies w (rad/s), as G(j w) of Section IV-B."""
        s = 1j * np.asarray(frequencies, dtype=np.float64)
        value = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(value, dtype=np.complex128)


def propagation(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    steering: SteeringModel = "second order",
) -> Transfer:
    """G(s) = H / (1 + H) of Section IV-B, with the predecessor's data only, at `speed` (m/s)."""
    numerator = feedback_numerator(parameters, gains, speed)
    if steering == "second order":
        return Transfer(numerator, characteristic_polynomial(parameters, gains, speed))
    denominator = np.zeros(5)  # s² R(s) + N(s)
    denominator[:3] = handling_polynomial(parameters, speed)
    denominator[1:] += numerator
    return Transfer(numerator, denominator)


def trace_propagation(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    assumed: VehicleParameters | None = None,
) -> Transfer:
    """Transfer function from the lateral offset of the predecessor's path to the follower's.

    F = n_e (k_e + (k_theta / v) s + (k_omega / v + (L + K_sg v²) / v²) s²) / Delta: the numerator
    n_e of e_lat / delta_f (Section III-F) times the law of eqs. (6), (7) with the reference's
    course y' / v and curvature y'' / v². There is no fit that smooths, so it overestimates the
    response above about 5 rad/s. At low frequency F = 1 - (e/kappa) w² / v² with the error e of
    `steady_cornering`: a car with a steady error to the outside of a curve amplifies. `assumed` are
    the parameters of the controller.
    """
    assumed = assumed or parameters
    feedforward = assumed.wheelbase + assumed.steer_gradient * speed * speed
    law = np.array(
        [gains.yaw_rate / speed + feedforward / speed**2, gains.heading / speed, gains.lateral]
    )
    numerator = np.convolve(lateral_numerator(parameters, speed), law)
    return Transfer(numerator, characteristic_polynomial(parameters, gains, speed))


def low_frequency_growth(parameters: VehicleParameters, gains: Gains, speed: float) -> float:
    """Coefficient c (s²) in |G(j w)| = 1 + c w² + O(w^3) for small w: R(0) / N(0), Section IV-B.

    As G = 1 / (1 + s² R / N). If it is positive, errors grow, with or without actuation.
    """
    handling = handling_polynomial(parameters, speed)
    return float(handling[-1] / feedback_numerator(parameters, gains, speed)[-1])


def chain_offsets(
    transfer: Transfer, frequencies: Array, alpha: float, followers: int
) -> ComplexArray:
    """Offset from the lead's path over the lead's offset, per follower; shape (followers, n).

    With alpha of eq. (5), d_i = (y_i - y_0) / y_0 for y_i = F (alpha y_(i-1) + (1 - alpha) y_0):
    d_0 = 0 and d_i = alpha F d_(i-1) + F - 1. For alpha = 1 it is F^i - 1, which grows with i
    unless F = 1; otherwise it converges to (F - 1) / (1 - alpha F).
    """
    factor = transfer.at(frequencies)
    rows = [np.zeros_like(factor)]
    for _ in range(followers):
        rows.append(alpha * factor * rows[-1] + factor - 1.0)
    return np.array(rows[1:])
