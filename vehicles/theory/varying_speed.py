"""Stability while the speed changes: accelerations with a stability certificate.

Proposition 1 of the paper (Section IV-A) states that bounds exist; this module computes them. While
the speed v changes, z' = (A(1/v) + v' E) z (see `linear_model`; the paper omits E). Let
V = w(v) z'P(v)z with A'P + PA = -Q for one fixed diagonal Q. Then

    dV/dt = w(v) z' (-Q + v' (S + h P)) z,   S = dP/dv + PE + E'P,   h = (dw/dv) / w,

and dP/dv = -P_gamma / v² from A'P_gamma + P_gamma A = -(A1'P + PA1).

Condition (iii): V decreases as long as v' (S + h P) < Q, for any v(t) in [slowest, fastest]. The
extreme eigenvalues bound braking and accelerating at each speed. The weight w(v) > 0 is free: h
makes both bounds equal, up to ten times those for w = 1. Q is tuned to make the smallest bound over
all speeds large.

Conditions (i) and (ii): dV/dt <= (-c + k |v'|) V, where c is the smallest decay rate of V at
constant speed and k the largest relative growth rate of V per 1 m/s², with the best h, over all
speeds. So V(t) <= V(0) exp(-c t + k * integral of |v'|), and V decays in the long run if the mean
of |v'| is below mu* = c / k. By the Cauchy-Schwarz inequality a mean of v'² below mu*² is
sufficient, and so is a finite integral of v'², whose mean tends to zero.

All this is for the linear loop with continuous, undelayed measurement and unlimited steering.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov
from scipy.optimize import brentq, minimize

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.gain_sets import is_stable_over
from vehicles.theory.linear_model import Array, closed_loop, speed_change_matrix

SLOWEST = 2.0  # Default lowest speed (m/s) of a certificate; below it the plant model changes
FASTEST = 36.0  # Default highest speed (m/s) of a certificate, 130 km/h
_TUNING_SPEEDS = 7  # Number of speeds at which Q is tuned, evenly spaced in ln v
_MEAN_SPEEDS = 60  # Number of speeds at which c and k are computed, likewise


@dataclass(frozen=True, slots=True)
class SpeedCertificate:
    """Certified accelerations of one car with given gains over an interval of speeds (m/s).

    For Proposition 1, which states no values. `weights` is the diagonal of Q in the units of the
    state. `holds`: the loop is stable at every constant speed of the interval; otherwise nothing is
    certified.
    """

    parameters: VehicleParameters
    gains: Gains
    slowest: float
    fastest: float
    weights: tuple[float, ...]
    holds: bool

    def bound(self, speed: float) -> float:
        """Largest certified |v'| (m/s²) at `speed` (m/s), mu* of (iii); 0 outside the interval."""
        if not (self.holds and self.slowest <= speed <= self.fastest):
            return 0.0
        change, energy = lyapunov_change(self.parameters, self.gains, speed, self.weights)
        balanced = change + balancing_growth(change, energy) * energy
        return 1.0 / float(np.linalg.eigvalsh(balanced)[-1])  # Rayleigh's quotient

    def mean_bound(self) -> tuple[float, float]:
        """Decay c (1/s) and sensitivity k (s/m) of (i) and (ii), mu* = c / k; else (0, inf)."""
        if not self.holds:
            return 0.0, np.inf
        decay, sensitivity = np.inf, 0.0
        for speed in np.geomspace(self.slowest, self.fastest, _MEAN_SPEEDS).tolist():
            change, energy = lyapunov_change(self.parameters, self.gains, speed, self.weights)
            decay = min(decay, 1.0 / float(np.linalg.eigvalsh(energy)[-1]))
            growth = eigh(change, energy, eigvals_only=True)  # in rising order
            sensitivity = max(sensitivity, 0.5 * float(growth[-1] - growth[0]))
        return decay, sensitivity


@lru_cache(maxsize=64)
def certify(
    parameters: VehicleParameters, gains: Gains, slowest: float = SLOWEST, fastest: float = FASTEST
) -> SpeedCertificate:
    """Compute a certificate over [slowest, fastest] (m/s) with tuned Q, for Proposition 1.

    A narrower interval gives larger bounds. Takes about 0.1 s; cached.
    """
    holds = is_stable_over(parameters, gains, slowest, fastest)
    speeds: list[float] = np.geomspace(slowest, fastest, _TUNING_SPEEDS).tolist()
    weights = tuned_weights(parameters, gains, speeds) if holds else (1.0,) * 6
    return SpeedCertificate(parameters, gains, slowest, fastest, weights, holds)


def lyapunov_change(
    parameters: VehicleParameters, gains: Gains, speed: float, weights: tuple[float, ...]
) -> tuple[Array, Array]:
    """Q^-1/2 S Q^-1/2 and Q^-1/2 P Q^-1/2 (see the module), each (6, 6), at `speed` (m/s)."""
    # In coordinates y = Q^1/2 z the right-hand side of Lyapunov's equation is the identity.
    return _solution(parameters, gains, speed, np.eye(6), np.sqrt(np.array(weights)))


def _solution(
    parameters: VehicleParameters, gains: Gains, speed: float, right: Array, root: Array
) -> tuple[Array, Array]:
    """S and P (see the module) for Q = `right`, in coordinates `root` * z."""
    constant, slope = closed_loop(parameters, gains)
    frozen, slope, entering = (
        matrix * root[:, None] / root
        for matrix in (constant + slope / speed, slope, speed_change_matrix())
    )
    energy = np.asarray(solve_continuous_lyapunov(frozen.T, -right), dtype=np.float64)
    by_gamma = solve_continuous_lyapunov(frozen.T, -_symmetric(energy @ slope))
    return np.asarray(_symmetric(energy @ entering) - by_gamma / speed**2), energy


def _symmetric(matrix: Array) -> Array:
    return np.asarray(matrix + matrix.T)


def balancing_growth(change: Array, energy: Array) -> float:
    """Growth rate h (s/m) of the weight w(v) that makes both bounds at this speed equal.

    The sum of the extreme eigenvalues of S + h P increases with h, as P is positive definite
    (Weyl's inequality). Its zero, by Brent's method, minimises the larger magnitude.
    """

    def imbalance(growth: float) -> float:
        eigenvalues = np.linalg.eigvalsh(change + growth * energy)
        return float(eigenvalues[0] + eigenvalues[-1])

    reach = 2.0 * float(np.abs(np.linalg.eigvalsh(change)).max() / np.linalg.eigvalsh(energy)[0])
    return float(brentq(imbalance, -reach, reach, xtol=1e-12 * reach))


def tuned_weights(
    parameters: VehicleParameters, gains: Gains, speeds: list[float]
) -> tuple[float, ...]:
    """Diagonal of Q for which the smallest balanced bound over `speeds` is large.

    Minimises a p-norm of all eigenvalues of Q^-1/2 (S + h P) Q^-1/2 over ln Q and the h of every
    speed (BFGS method), with increasing p. Any Q > 0 is valid. It is rounded to three digits, so
    that the last bits of a linear algebra library do not matter.
    """
    # S and P for each unit Q = e_i e_i' and speed, shapes (n, 6, 6, 6); both are linear in Q.
    units, root = np.eye(6)[:, :, None] * np.eye(6)[:, None, :], np.ones(6)
    rows = [[_solution(parameters, gains, v, unit, root) for unit in units] for v in speeds]
    changes, energies = np.moveaxis(np.array(rows), 2, 0)

    def spread(unknowns: Array, power: float) -> float:
        weights, growths = np.exp(unknowns[:6]), unknowns[6:, None, None, None]
        total = np.einsum("i,kiab->kab", weights, changes + growths * energies)
        total /= np.sqrt(np.outer(weights, weights))
        magnitudes = np.abs(np.linalg.eigvalsh(total))
        largest = magnitudes.max()
        return float(np.log(largest) + np.log(np.sum((magnitudes / largest) ** power)) / power)

    unknowns = np.zeros(6 + len(speeds))
    for power in (8.0, 64.0):
        unknowns = minimize(spread, unknowns, (power,), "BFGS").x
    logarithms = unknowns[:6] - unknowns[:6].mean()
    return tuple(float(f"{weight:.3g}") for weight in np.exp(logarithms))
