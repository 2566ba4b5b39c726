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
from typing import Final, NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import WALKING_PACE

STEP: Final = 0.025
MIN_STEP: Final = 0.3
"""Time (s), or if it is more distance (m), between the places at which curvature is looked up. No
usual control period: so a jump of the curvature is not seen late by the same part of a step always.
"""
MEMORY: Final = 0.35
MIN_MEMORY: Final = 3.0
"""Time (s), or if it is more distance (in units of b), after which a motion has faded: to a tenth
at 30 m/s, faster at lower speeds."""


class AlongPath(NamedTuple):
    """A quantity at places `step` (m) apart, the first `start` (m) ahead of the car.

    A single value holds everywhere.
    """

    start: float
    step: float
    values: Sequence[float]

    def at(self, distance: float) -> float:
        """Value `distance` (m) ahead, interpolated; constant beyond the ends."""
        start, step, values = self
        where, last = (distance - start) / step, len(values) - 1
        if where <= 0.0 or last == 0:
            return values[0]
        if where >= last:
            return values[last]
        index = int(where)
        return values[index] + (where - index) * (values[index + 1] - values[index])

    def mean(self, distance: float, apart: float) -> float:
        """Mean at `distance` (m) ahead and `apart` (m) before and after, weights 1/4, 1/2, 1/4.

        It keeps to the path whose curvature is that mean.
        """
        if len(self.values) == 1:
            return self.values[0]
        beside = self.at(distance - apart) + self.at(distance + apart)
        return 0.25 * beside + 0.5 * self.at(distance)


class PathMotion(NamedTuple):
    """The motion that keeps to a path, by the inverse of eqs. (1), (2).

    Curvature κ/cos θ̃ (1/m), heading θ̃ against the path (rad), angle δ of the wheels (rad).
    """

    curvature: AlongPath
    heading: AlongPath
    steering: AlongPath


Pair = tuple[float, float]


class PathKeeping:
    """Motion of one car that keeps to paths: the inverse of eqs. (1), (2) with its parameters."""

    def __init__(self, p: VehicleParameters) -> None:
        self._wheelbase, self._steer_gradient = p.wheelbase, p.steer_gradient
        self._rear = p.rear_axle_distance
        self._moment = p.mass * p.front_axle_distance
        self._stiffness = p.wheelbase * p.rear_cornering_stiffness
        self._square = self._stiffness / p.yaw_inertia
        ratio = p.rear_cornering_stiffness / p.front_cornering_stiffness
        self._by_heading, self._by_turn = 1.0 + ratio, p.front_axle_distance - ratio * self._rear

    def slip(self, speed: float) -> float:
        """Steady slip l (m) at `speed` (m/s): `VehicleParameters.steady_slip_per_curvature`."""
        return self._rear - self._moment * speed * speed / self._stiffness

    def motion(
        self,
        curvatures: Callable[[float, float, int], Sequence[float]],
        reach: tuple[float, float],
        speed: float,
    ) -> PathMotion:
        """Motion that keeps to a path at constant `speed` (m/s), by the inverse of eqs. (1), (2).

        `curvatures(start, step, count)` (1/m) are those at places along the path, from `start` (m)
        ahead of the car on; the motion is returned within `reach` (m ahead). Exact where the
        curvature is linear between places.
        """
        v = max(speed, WALKING_PACE)
        step = max(STEP * v, MIN_STEP)
        first = math.floor(reach[0] / step)
        fading = math.ceil(max(MEMORY * v, MIN_MEMORY * self._rear) / step)
        count = fading + math.ceil(reach[1] / step) - first + 1
        looked_up = curvatures((first - fading) * step, step, count)
        slip = self.slip(v)
        gradient = self._wheelbase + self._steer_gradient * v * v
        longer = 0.5 * slip * slip  # 1/cos θ̃ = 1 + (l κ)²/2, to fourth order
        kappa = looked_up[0] + longer * looked_up[0] ** 3
        if looked_up.count(looked_up[0]) == count:  # an arc or a line
            return PathMotion(
                AlongPath(0.0, step, (kappa,)),
                AlongPath(0.0, step, (math.atan(-slip * kappa),)),
                AlongPath(0.0, step, (gradient * kappa,)),
            )
        (keep, gain), (loss, rest), (of_heading, of_turn) = self._off_an_arc(step, v, slip)
        by_heading, by_turn = self._by_heading, self._by_turn
        heading = turn = 0.0  # θ̃ and ρ less those of an arc of the same curvature
        kappas, headings, angles = [], [], []
        for k, flat in enumerate(looked_up[1:], 1):
            following = flat + longer * flat * flat * flat
            change = following - kappa
            if change or heading:  # both are 0 before the first change
                heading, turn = (
                    keep * heading + gain * turn + of_heading * change,
                    loss * heading + rest * turn + of_turn * change,
                )
            kappa = following
            if k >= fading:
                kappas.append(kappa)
                headings.append(math.atan(heading - slip * kappa))
                angles.append(gradient * kappa - by_heading * heading + by_turn * turn)
        start = first * step
        return PathMotion(
            AlongPath(start, step, kappas),
            AlongPath(start, step, headings),
            AlongPath(start, step, angles),
        )

    def _off_an_arc(self, step: float, v: float, slip: float) -> tuple[Pair, Pair, Pair]:
        """Change of θ̃ and ρ, less those of an arc, over a `step` (m) of a path: eqs. (1), (2).

        Previous differences fade by the matrix, whose rows come first, and a curvature that changes
        evenly by 1 adds the vector: while it changes by κ' the differences approach
        (b l - v²/ω²) κ' and -l κ', and the rest of them fades like any other motion. `slip` is l.
        """
        square, b = self._square, self._rear
        (keep, gain), (loss, rest) = fading = _fading(step / v, v, square, b * square / v)
        heading, turn = (b * slip - v * v / square) / step, -slip / step
        answer = (
            heading - keep * heading - gain * turn,
            turn - loss * heading - rest * turn,
        )
        return *fading, answer


def _fading(span: float, v: float, square: float, damping: float) -> tuple[Pair, Pair]:
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
    return (even - middle * odd, v * odd), (-square / v * odd, even + middle * odd)
