"""Transfer functions of lateral errors down the convoy, in closed form (Section IV-B).

Two chains of linear loops, each follower steering relative to the one ahead:

`propagation`, the paper's: feedback on x_i - x_(i-1), the difference of both vehicles' lateral
offset and heading at one instant. The fed-back signal u_i = K x_i obeys u_i = G u_(i-1) with
G = H / (1 + H), and since x_i = (M_0 + B K)^-1 B u_(i-1), every component of x does so from the
first follower on: e_lat,(i+1) = G e_lat,i. Differences from the paper's text:

- N(0) lacks the factor C_f that K(s) carries: N(0) = C_f C_r (a + b) k_e. The sign is the same.
- N(0)/R(0) > 0, and with it |G| > 1 at low frequency, needs R(0) > 0: true at any speed for an
  understeering car and below the critical speed for an oversteering one. "det M_0(s) = 0" is meant
  at s = 0.
  Amplification at some frequency is certain for any car: with two integrators in the loop Bode's
  integral of ln|G| / w² over all frequencies is not negative.
- (M_0 + B K)^-1 B K has rank one; |G| is its only non-zero eigenvalue in magnitude and a lower
  bound of sigma_max, which also mixes metres with radians. |G| <= 1 is necessary, not equivalent.

`trace_propagation`, nearer the emulator: a follower knows the path of its predecessor, not its
heading at the same instant. Its reference is that path: lateral offset y, course y' / v, curvature
y'' / v², with feedforward. Lateral offset to lateral offset at the same place of the road.

With the lead's data and weight alpha on the predecessor, either chain becomes
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

SteeringModel = Literal["second order", "instantaneous"]
"""Steering by eq. (4), or H_a = 1 as in the paper's Section IV-B."""


@dataclass(frozen=True, slots=True)
class Transfer:
    """A rational transfer function (G of Section IV-B); coefficients in descending powers of s."""

    numerator: Array
    denominator: Array

    def at(self, frequencies: Array) -> ComplexArray:
        """Value at j w for frequencies w (rad/s), like G(j w) of Section IV-B."""
        s = 1j * np.asarray(frequencies, dtype=np.float64)
        value = np.polyval(self.numerator, s) / np.polyval(self.denominator, s)
        return np.asarray(value, dtype=np.complex128)


def propagation(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    steering: SteeringModel = "second order",
) -> Transfer:
    """G(s) = H / (1 + H) of Section IV-B, predecessor's data only, at `speed` (m/s).

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
    steering: SteeringModel = "second order",
    known: VehicleParameters | None = None,
) -> Transfer:
    """Lateral offset of a follower over that of its predecessor's path.

    F = n_e (k_e + (k_theta / v) s + (k_omega / v + (L + K_sg v²) / v²) s²) / Delta: the numerator
    n_e of e_lat / delta_f (Section III-F) times the law of eqs. (6), (7) with the reference's
    course y' / v and curvature y'' / v². Not smoothed by any fit, so it overstates the response
    above some 5 rad/s; without actuation it does not even fall off towards high frequency. At low
    frequency F = 1 - (e/kappa) w² / v² with the steady cornering error e of
    `linear_model.steady_cornering`: a car that settles outside the path on curves amplifies.
    `known` are the parameters that the controller assumes.
    """
    assumed = known or parameters
    feedforward = assumed.wheelbase + assumed.steer_gradient * speed * speed
    law = np.array(
        [gains.yaw_rate / speed + feedforward / speed**2, gains.heading / speed, gains.lateral]
    )
    numerator = np.convolve(lateral_numerator(parameters, speed), law)
    if steering == "second order":
        return Transfer(numerator, characteristic_polynomial(parameters, gains, speed))
    return Transfer(numerator, _instantaneous_denominator(parameters, gains, speed))


def _instantaneous_denominator(parameters: VehicleParameters, gains: Gains, speed: float) -> Array:
    """s² R(s) + N(s), Section IV-B; shape (5,)."""
    denominator = np.zeros(5)
    denominator[:3] = handling_polynomial(parameters, speed)
    denominator[1:] += feedback_numerator(parameters, gains, speed)
    return denominator


def low_frequency_growth(parameters: VehicleParameters, gains: Gains, speed: float) -> float:
    """The c (s²) of |G(j w)| = 1 + c w² + O(w^3) for small w: R(0) / N(0), Section IV-B.

    G = 1 / (1 + s² R / N). Positive, so that errors grow, whenever R(0) is: see the module.
    Steering actuation does not change it.
    """
    handling = handling_polynomial(parameters, speed)
    return float(handling[-1] / feedback_numerator(parameters, gains, speed)[-1])


def chain_offsets(
    transfer: Transfer, frequencies: Array, alpha: float, followers: int
) -> ComplexArray:
    """Offset from the lead's path over the lead's offset, per follower; shape (followers, n).

    Beyond the paper, alpha being that of eq. (5):
    (y_i - y_0) / y_0 for y_i = F (alpha y_(i-1) + (1 - alpha) y_0): with d_0 = 0,
    d_i = alpha F d_(i-1) + F - 1. At alpha = 1 it is F^i - 1 and grows with i wherever F is not 1;
    otherwise it levels off at (F - 1) / (1 - alpha F).
    """
    factor = transfer.at(frequencies)
    rows = [np.zeros_like(factor)]
    for _ in range(followers):
        rows.append(alpha * factor * rows[-1] + factor - 1.0)
    return np.array(rows[1:])
