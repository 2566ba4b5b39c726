"""Transfer functions of lateral errors down the convoy, in closed form (Section IV-B).

There are two chains of linear loops, in which each follower steers relative to its predecessor.

`propagation`, the paper's chain: feedback on x_i - x_(i-1), the difference of both vehicles'
lateral offset and heading at one instant. The signal u_i = K x_i satisfies u_i = G u_(i-1) with
G = H / (1 + H). Since x_i = (M_0 + B K)^-1 B u_(i-1), so does every component of x from the first
follower on: e_lat,(i+1) = G e_lat,i. Differences from the paper's text:

- N(0) lacks the factor C_f of K(s): N(0) = C_f C_r (a + b) k_e. The sign is the same.
- N(0)/R(0) > 0, and so |G| > 1 at low frequency, requires R(0) > 0. This is true at any speed for
  an understeering car and below the critical speed for an oversteering car. "det M_0(s) = 0" must
  refer to s = 0.
- Any car amplifies at some frequency: with two integrators in the loop, Bode's integral of
  ln|G| / w² over all frequencies is not negative.
- (M_0 + B K)^-1 B K has rank one. |G| is the magnitude of its only non-zero eigenvalue and a lower
  bound of sigma_max, which also mixes metres with radians. |G| <= 1 is necessary, not sufficient.

`trace_propagation`, closer to the emulator: a follower knows the path of its predecessor, not its
heading at the same instant. Its reference is that path: lateral offset y, course y' / v, curvature
y'' / v², with feedforward. The transfer function is from lateral offset to lateral offset at the
same position on the road.

With the lead's data and the weight alpha of the predecessor, either chain becomes
y_i = F (alpha y_(i-1) + (1 - alpha) y_0), which contracts if alpha |F| < 1 at every frequency.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import (
    characteristic_polynomial,
    feedback_numerator,
    handling_polynomial,
    lateral_numerator,
)

Array = NDArray[np.float64]
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
    """G(s) = H / (1 + H) of Section IV-B, with the predecessor's data only, at `speed` (m/s).

    With steering by eq. (4), H becomes H_a H and the denominator Delta(s, K) / w_n².
    """
    numerator = feedback_numerator(parameters, gains, speed)
    if steering == "second order":
        return Transfer(numerator, characteristic_polynomial(parameters, gains, speed))
    return Transfer(numerator, _instantaneous_denominator(parameters, gains, speed))


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
    response above about 5 rad/s. At low frequency
    F = 1 - (e/kappa) w² / v² with the steady cornering error e of `linear_model.steady_cornering`:
    a car with a steady error to the outside of a curve amplifies. `assumed` are the parameters of
    the controller.
    """
    assumed = assumed or parameters
    feedforward = assumed.wheelbase + assumed.steer_gradient * speed * speed
    law = np.array(
        [gains.yaw_rate / speed + feedforward / speed**2, gains.heading / speed, gains.lateral]
    )
    numerator = np.convolve(lateral_numerator(parameters, speed), law)
    return Transfer(numerator, characteristic_polynomial(parameters, gains, speed))


def _instantaneous_denominator(parameters: VehicleParameters, gains: Gains, speed: float) -> Array:
    """s² R(s) + N(s), Section IV-B; shape (5,)."""
    denominator = np.zeros(5)
    denominator[:3] = handling_polynomial(parameters, speed)
    denominator[1:] += feedback_numerator(parameters, gains, speed)
    return denominator


def low_frequency_growth(parameters: VehicleParameters, gains: Gains, speed: float) -> float:
    """Coefficient c (s²) in |G(j w)| = 1 + c w² + O(w^3) for small w: R(0) / N(0), Section IV-B.

    G = 1 / (1 + s² R / N). If R(0) is positive, so is c, and errors grow. Steering actuation does
    not change it.
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
