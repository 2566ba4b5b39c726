"""Stability while the speed changes: accelerations with a stability certificate.

Proposition 1 of the paper (Section IV-A) states that bounds exist; this module computes them. While
the speed v changes, z' = (A(1/v) + v' E) z (see `linear_model`; the paper omits E). Let
V = w(v) z'P(v)z with A'P + PA = -Q for one fixed diagonal Q. Then

    dV/dt = w(v) z' (-Q + v' (S + h P)) z,   S = dP/dv + PE + E'P,   h = (dw/dv) / w,

and dP/dv = -P_gamma / v² from A'P_gamma + P_gamma A = -(A1'P + PA1).

Condition (iii): V decreases as long as v' (S + h P) < Q, for any v(t) in [slowest, fastest]. The
extreme eigenvalues give pointwise bounds on v', one for braking and one for accelerating. The
weight w(v) > 0 is free: h makes both bounds equal at each speed, up to ten times those for w = 1. Q
is tuned to make the smallest bound over all speeds large.

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
from scipy.linalg import eigh, expm, solve_continuous_lyapunov
from scipy.optimize import brentq, minimize

from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.gain_sets import is_stable_over
from vehicles.theory.linear_model import Array, closed_loop, closed_loop_at, speed_change_matrix

SLOWEST = 2.0  # Default lowest speed (m/s) of a certificate; below it the plant model changes
FASTEST = 36.0  # Default highest speed (m/s) of a certificate, 130 km/h
UNIT_WEIGHTS: tuple[float, ...] = (1.0,) * 6  # Diagonal of Q = I, for comparison; far from optimal
_TUNING_SPEEDS = 7  # Number of speeds at which Q is tuned, evenly spaced in ln v


@dataclass(frozen=True, slots=True)
class AccelerationBounds:
    """Magnitudes (m/s²) below which braking and accelerating are certified; may be infinite.

    Counterpart of mu* of Proposition 1, condition (iii), for which the paper has no value.
    """

    braking: float
    accelerating: float


@dataclass(frozen=True, slots=True)
class SpeedCertificate:
    """Certified accelerations of one car with given gains over an interval of speeds (m/s).

    For Proposition 1, condition (iii). `weights` is the diagonal of Q in the units of the state.
    `holds`: the loop is stable at every constant speed of the interval; otherwise bounds are zero.
    """

    parameters: VehicleParameters
    gains: Gains
    slowest: float
    fastest: float
    weights: tuple[float, ...]
    holds: bool

    def bounds(self, speed: float) -> AccelerationBounds:
        """Certified braking and acceleration (m/s²) at `speed` (m/s); zero outside the interval."""
        if not (self.holds and self.slowest <= speed <= self.fastest):
            return AccelerationBounds(0.0, 0.0)
        change, energy = lyapunov_change(self.parameters, self.gains, speed, self.weights)
        return bounds_from(change + balancing_growth(change, energy) * energy)


@lru_cache(maxsize=64)
def certify(
    parameters: VehicleParameters, gains: Gains, slowest: float = SLOWEST, fastest: float = FASTEST
) -> SpeedCertificate:
    """Compute a certificate over [slowest, fastest] (m/s) with tuned Q, for Proposition 1 (iii).

    A narrower interval gives larger bounds. Takes about 50 ms; cached.
    """
    weights, holds = UNIT_WEIGHTS, is_stable_over(parameters, gains, slowest, fastest)
    if holds:
        speeds = np.geomspace(slowest, fastest, _TUNING_SPEEDS)
        weights = tuned_weights(parameters, gains, speeds.tolist())
    return SpeedCertificate(parameters, gains, slowest, fastest, weights, holds)


def certified_acceleration(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    slowest: float = SLOWEST,
    fastest: float = FASTEST,
) -> tuple[float, float]:
    """Certified (braking, accelerating) in m/s² at `speed` (m/s), see `SpeedCertificate`."""
    bounds = certify(parameters, gains, slowest, fastest).bounds(speed)
    return bounds.braking, bounds.accelerating


def lyapunov_change(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    weights: tuple[float, ...],
    *,
    speed_term: bool = True,
) -> tuple[Array, Array]:
    """Q^-1/2 S Q^-1/2 and Q^-1/2 P Q^-1/2 (see the module), each (6, 6), at `speed` (m/s).

    P and its derivative with respect to gamma solve Lyapunov's equation. Without `speed_term` E is
    omitted, as in the A(gamma(t)) of Proposition 1.
    """
    root = np.sqrt(np.array(weights))
    # In coordinates y = Q^1/2 z the right-hand side of Lyapunov's equation is the identity.
    return _solution(parameters, gains, speed, np.eye(6), root, speed_term=speed_term)


def _solution(
    parameters: VehicleParameters,
    gains: Gains,
    speed: float,
    right: Array,
    root: Array,
    *,
    speed_term: bool = True,
) -> tuple[Array, Array]:
    """S and P (see the module) for Q = `right`, in coordinates `root` * z."""
    constant, slope = closed_loop(parameters, gains)
    frozen, slope, entering = (
        matrix * root[:, None] / root
        for matrix in (constant + slope / speed, slope, speed_change_matrix())
    )
    energy = np.asarray(solve_continuous_lyapunov(frozen.T, -right), dtype=np.float64)
    by_gamma = solve_continuous_lyapunov(frozen.T, -_symmetric(energy @ slope))
    change = np.asarray(-by_gamma / speed**2, dtype=np.float64)
    return (change + _symmetric(energy @ entering) if speed_term else change), energy


def _symmetric(matrix: Array) -> Array:
    return np.asarray(matrix + matrix.T)


def bounds_from(change: Array) -> AccelerationBounds:
    """Largest |v'| (m/s²) with v' * change < I for both signs of v', by Rayleigh's quotient."""
    least, *_, most = np.linalg.eigvalsh(change).tolist()
    return AccelerationBounds(
        -1.0 / least if least < 0.0 else np.inf, 1.0 / most if most > 0.0 else np.inf
    )


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
    unknowns = np.zeros(6 + len(speeds))
    for power in (4.0, 16.0, 64.0):
        arguments = (changes, energies, power)
        unknowns = minimize(
            _spread, unknowns, arguments, "BFGS", jac=True, options={"gtol": 1e-4}
        ).x
    logarithms = unknowns[:6] - unknowns[:6].mean()
    return tuple(float(f"{weight:.3g}") for weight in np.exp(logarithms))


def _spread(unknowns: Array, changes: Array, energies: Array, power: float) -> tuple[float, Array]:
    """Logarithm of the p-norm of all eigenvalues, and its gradient in (ln Q, h)."""
    weights, growths = np.exp(unknowns[:6]), unknowns[6:]
    root = np.sqrt(weights)
    terms = changes + growths[:, None, None, None] * energies
    total = np.einsum("i,kiab->kab", weights, terms) / root[:, None] / root
    eigenvalues, vectors = np.linalg.eigh(total)
    directions = vectors / root[:, None]  # back to z, one column per eigenvalue
    magnitudes = np.abs(eigenvalues)
    largest = float(magnitudes.max())
    powers = (magnitudes / largest) ** power
    sensitivity = powers / powers.sum() / eigenvalues
    by_weight = np.einsum("kj,kaj,kiab,kbj->i", sensitivity, directions, terms, directions)
    by_weight -= np.einsum("kj,kj,kij->i", sensitivity, eigenvalues, directions**2)
    energy = np.einsum("i,kiab->kab", weights, energies)
    by_growth = np.einsum("kj,kaj,kab,kbj->k", sensitivity, directions, energy, directions)
    value = float(np.log(largest) + np.log(powers.sum()) / power)
    return value, np.concatenate([by_weight * weights, by_growth])


# ---- Bounds on the integral of the acceleration


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
        """Bound on the growth of V over `span` (s), given the integral `change` (m/s) of |v'|."""
        return float(np.exp(self.sensitivity * change - self.decay * span))


def integral_bound(
    parameters: VehicleParameters,
    gains: Gains,
    slowest: float,
    fastest: float,
    *,
    speed_term: bool = True,
) -> IntegralBound:
    """Bounds c and k over [slowest, fastest] (m/s), with the Q of `certify`.

    `speed_term` as in `lyapunov_change`. Raises ValueError if the loop is not stable at all
    constant speeds of the interval.
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
    parameters: VehicleParameters, gains: Gains, speed: float, weights: tuple[float, ...]
) -> Array:
    """A root F of P = F'F at `speed` (m/s), so that |F z|² is Lyapunov's z'Pz; shape (6, 6)."""
    _, energy = lyapunov_change(parameters, gains, speed, weights)
    return np.asarray(np.linalg.cholesky(energy).T * np.sqrt(np.array(weights)))


def error_growth(
    parameters: VehicleParameters, gains: Gains, before: float, after: float, acceleration: float
) -> float:
    """Largest growth of an error over a linear change of speed, see `transition`, in the norm of P.

    P is that at the first speed (Lyapunov). For comparison with `integral_bound`.
    """
    certificate = certify(parameters, gains, min(before, after), max(before, after))
    root = energy_root(parameters, gains, before, certificate.weights)
    moved = transition(parameters, gains, before, after, acceleration)
    return float(np.linalg.norm(root @ moved @ np.linalg.inv(root), 2))
