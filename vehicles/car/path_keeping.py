"""How a car moves whose centre of mass keeps exactly to a path: the inverse of eqs. (1), (2).

Steering that puts the centre of mass on a path of curvature κ leaves one degree of freedom: how
the body stands to the path. With θ̃ its heading against the path, ρ its yaw per distance and v its
speed, force and moment of both axles at the lateral acceleration v²κ give

    dθ̃/dt = v (ρ - κ),    dρ/dt = (m a v / I) κ - (ω²/v) (θ̃ + b ρ),    ω² = (a+b) C_r / I.

For any car this is stable (damping b ω²/v), so past curvature alone determines θ̃ and ρ. On an arc
they settle at θ̃ = -l κ and ρ = κ, l = b - m a v²/((a+b) C_r) being `steady_slip_per_curvature`;
while κ changes evenly by κ' per distance, at

    θ̃ = -l κ + (b l - v²/ω²) κ',    ρ = κ - l κ',

and what is left of another motion before fades. The wheels stand at

    δ = m v² κ / C_f - (C_r/C_f) (θ̃ + b ρ) - θ̃ + a ρ,

on an arc the angle of eq. (6). At walking pace all this becomes geometry: θ̃ relaxes over the
distance b, and δ = (a+b) ρ.

The speed v of eqs. (1), (2) is that along the body, which is cos θ̃ of that along the path. With
tan θ̃ for θ̃ and κ/cos θ̃ for κ the above therefore holds for large θ̃ as well, but for a term of
θ̃² dθ̃/dt. On a radius of 8 m at walking pace κ/cos θ̃ is 2 % more than κ, and the wheels stand 0.4°
further in: without these, feedback at the paper's gains supplies them from an offset of decimetres.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import WALKING_PACE

STEP, LEAST_STEP = 0.025, 0.3
"""Time (s), or if it is more distance (m), between the places at which curvature is looked up. No
usual control period: so a jump of the curvature is not seen late by the same part of a step always.
"""
MEMORY, LEAST_MEMORY = 0.35, 3.0
"""Time (s), or if it is more distance (in units of b), after which a motion has faded: to a tenth
at 30 m/s, faster at lower speeds."""


class OnPath(NamedTuple):
    """Curvature κ/cos θ̃ (1/m), heading θ̃ against the path (rad), angle δ of the wheels (rad).

    By the inverse of eqs. (1), (2).
    """

    curvature: float
    heading: float
    steering: float


class PathMotion:
    """The motion of eqs. (1), (2) that keeps to a path, each `step` (m) from `start` (m) on."""

    def __init__(self, start: float, step: float, places: list[tuple[float, float, float]]) -> None:
        self._start = start
        self._step = step
        self._places = places

    def at(self, distance: float) -> OnPath:
        """Motion `distance` (m) ahead, interpolated; beyond the ends as there (eqs. (1), (2))."""
        if len(self._places) == 1:  # the same everywhere
            return OnPath(*self._places[0])
        where = (distance - self._start) / self._step
        index = min(max(int(where), 0), len(self._places) - 2)
        share = min(max(where - index, 0.0), 1.0)
        (kappa, theta, delta), (next_kappa, next_theta, next_delta) = self._places[
            index : index + 2
        ]
        return OnPath(
            kappa + share * (next_kappa - kappa),
            theta + share * (next_theta - theta),
            delta + share * (next_delta - delta),
        )

    def mean(self, distance: float, apart: float) -> OnPath:
        """Mean motion (eqs. (1), (2)) about `distance` (m) ahead and so far `apart` (m) from it.

        With weights 1/4, 1/2, 1/4: what keeps to the path whose curvature is such a mean.
        """
        if len(self._places) == 1:
            return OnPath(*self._places[0])
        near, here, far = self.at(distance - apart), self.at(distance), self.at(distance + apart)
        return OnPath(
            0.25 * (near.curvature + far.curvature) + 0.5 * here.curvature,
            0.25 * (near.heading + far.heading) + 0.5 * here.heading,
            0.25 * (near.steering + far.steering) + 0.5 * here.steering,
        )


def path_motion(
    curvatures: Callable[[float, float, int], Sequence[float]],
    reach: tuple[float, float],
    speed: float,
    p: VehicleParameters,
) -> PathMotion:
    """Motion that keeps to a path at constant `speed` (m/s), by the inverse of eqs. (1), (2).

    `curvatures(start, step, count)` (1/m) are those at places along the path, from `start` (m)
    ahead of the car on; the motion is told within `reach` (m ahead). Exact where the curvature is
    linear between places.
    """
    v = max(speed, WALKING_PACE)
    step = max(STEP * v, LEAST_STEP)
    first = math.floor(reach[0] / step)
    fading = math.ceil(max(MEMORY * v, LEAST_MEMORY * p.rear_axle_distance) / step)
    start, count = (first - fading) * step, fading + math.ceil(reach[1] / step) - first + 1
    found = curvatures(start, step, count)
    steady = p.steady_slip_per_curvature(v)
    longer = 0.5 * steady * steady  # 1/cos θ̃ = 1 + (l κ)²/2, to fourth order
    kappa = found[0] + longer * found[0] ** 3
    if found.count(found[0]) == count:  # an arc or a line, as far as it counts
        gradient = p.wheelbase + p.steer_gradient * v * v
        return PathMotion(start, step, [(kappa, math.atan(-steady * kappa), gradient * kappa)])
    square = p.wheelbase * p.rear_cornering_stiffness / p.yaw_inertia
    a, b = p.front_axle_distance, p.rear_axle_distance
    lag = b * steady - v * v / square
    keep, gain, loss, rest = _fading(step / v, v, square, b * square / v)
    push = p.mass * v * v / p.front_cornering_stiffness
    ratio = p.rear_cornering_stiffness / p.front_cornering_stiffness
    rate = heading = turn = 0.0
    places = []
    for k in range(1, count):
        following = found[k]
        following += longer * following * following * following
        change = (following - kappa) / step
        # What the motion is off the one that suits the rate of curvature from here on.
        heading += lag * (rate - change)
        turn -= steady * (rate - change)
        heading, turn = keep * heading + gain * turn, loss * heading + rest * turn
        kappa, rate = following, change
        if k >= fading:
            theta = heading - steady * kappa + lag * rate
            rho = turn + kappa - steady * rate
            steering = push * kappa - ratio * (theta + b * rho) - theta + a * rho
            places.append((kappa, math.atan(theta), steering))
    return PathMotion(start + fading * step, step, places)


def _fading(
    span: float, v: float, square: float, damping: float
) -> tuple[float, float, float, float]:
    """Rows of the matrix by which a deviation (θ̃, ρ) fades in `span` (s): e^(At) of eqs. (1), (2).

    A = [[0, v], [-square/v, -damping]], whose eigenvalues are -damping/2 ± their `spread`.
    """
    middle = -0.5 * damping
    spread = middle * middle - square
    root = math.sqrt(abs(spread))
    if spread > 0.0:
        slow, fast = math.exp((middle + root) * span), math.exp((middle - root) * span)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / root
    else:
        fade = math.exp(middle * span)
        even = fade * math.cos(root * span)
        odd = fade * (math.sin(root * span) / root if root > 0.0 else span)
    return even - middle * odd, v * odd, -square / v * odd, even + middle * odd
