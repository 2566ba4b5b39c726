"""Stability while the speed changes, from the integral of the acceleration (Proposition 1).

With V = w(v) z'P(v)z, A'P + PA = -Q and z' = (A(1/v) + v'E) z (see `varying_speed`),

    dV/dt = w(v) z' (-Q + v' (S + h P)) z  <=  (-c + k |v'|) V,    h = (dw/dv) / w,

where c is the smallest decay rate of V at constant speed and k the largest relative growth rate of
V per 1 m/s² of acceleration, both over all speeds of the interval. h shifts the eigenvalues of S
relative to P, so the best h centres them. So

    V(t) <= V(0) exp(-c t + k * integral of |v'|),

and V decays in the long run if the mean of |v'| is below mu* = c / k: condition (i). By the
Cauchy-Schwarz inequality a mean of v'² below mu*² is sufficient, condition (ii). A finite integral
of v'² is also sufficient, as its mean tends to zero.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, expm

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.linear_model import closed_loop_at, speed_change_matrix
from vehicles.theory.varying_speed import certify, lyapunov_change

Array = NDArray[np.float64]
Weights = tuple[float, ...]

SPEEDS = 60  # Number of speeds at which c and k are computed, evenly spaced in ln v
STEPS = 100  # Steps of a transition matrix; within 5e-3 (relative) of a numerical integrator


@dataclass(frozen=True, slots=True)
class IntegralBound:
    """c (1/s) and k (s/m) of one car with given gains, for Proposition 1 (not in the paper)."""

    decay: float
    sensitivity: float

    @property
    def mean_acceleration(self) -> float:
        """mu* (m/s²) of Proposition 1, (i) and (ii): bound on the mean of |v'|."""
        return self.decay / self.sensitivity

    def energy_ratio(self, span: float, change: float) -> float:
        """Bound on the growth of V over `span` (s), given the integral `change` (m/s) of |v'|.

        Lyapunov's method, for Proposition 1.
        """
        return float(np.exp(self.sensitivity * change - self.decay * span))


def integral_bound(
    parameters: VehicleParameters,
    gains: Gains,
    slowest: float,
    fastest: float,
    *,
    speed_term: bool = True,
) -> IntegralBound:
    """Bounds c and k over [slowest, fastest] (m/s), for Proposition 1, with the Q of `certify`.

    Without `speed_term` the system is that of the paper, without E. Raises ValueError if the loop
    is not stable at all constant speeds of the interval.
    """
    certificate = certify(parameters, gains, slowest, fastest)
    if not certificate.holds:
        raise ValueError(f"not stable at all speeds from {slowest} to {fastest} m/s")
    decay, sensitivity = np.inf, 0.0
    for speed in np.geomspace(slowest, fastest, SPEEDS).tolist():
        change, energy = lyapunov_change(
            parameters, gains, speed, certificate.weights, speed_term=speed_term
        )
        decay = min(decay, 1.0 / float(np.linalg.eigvalsh(energy)[-1]))
        growth = eigh(change, energy, eigvals_only=True)  # in rising order
        sensitivity = max(sensitivity, 0.5 * float(growth[-1] - growth[0]))
    return IntegralBound(decay, sensitivity)


def transition(
    parameters: VehicleParameters, gains: Gains, before: float, after: float, acceleration: float
) -> Array:
    """Transition matrix of Proposition 1's system over a linear change of speed; shape (6, 6).

    From `before` to `after` (m/s) by `acceleration` (m/s², positive), with the term v' E. In STEPS
    steps, each a matrix exponential at the speed of its middle.
    """
    span = abs(after - before) / acceleration / STEPS
    rate = (after - before) / (span * STEPS)
    product = np.eye(6)
    for k in range(STEPS):
        speed = before + (k + 0.5) * (after - before) / STEPS
        matrix = closed_loop_at(parameters, gains, speed) + rate * speed_change_matrix()
        product = expm(matrix * span) @ product
    return np.asarray(product)


def energy_root(
    parameters: VehicleParameters, gains: Gains, speed: float, weights: Weights
) -> Array:
    """A root F of P = F'F at `speed` (m/s), so that |F z|² is Lyapunov's z'Pz; shape (6, 6)."""
    _, energy = lyapunov_change(parameters, gains, speed, weights)
    return np.asarray(np.linalg.cholesky(energy).T * np.sqrt(np.array(weights)))


def error_growth(
    parameters: VehicleParameters, gains: Gains, before: float, after: float, acceleration: float
) -> float:
    """Largest growth of the norm of an error over a linear change of speed; see `transition`.

    The norm is that of P at the first speed. For comparison with the bound of Lyapunov's method,
    for Proposition 1.
    """
    certificate = certify(parameters, gains, min(before, after), max(before, after))
    root = energy_root(parameters, gains, before, certificate.weights)
    moved = transition(parameters, gains, before, after, acceleration)
    return float(np.linalg.norm(root @ moved @ np.linalg.inv(root), 2))
