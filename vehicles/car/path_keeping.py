"""Motion of a car whose centre of mass follows a path exactly: the inverse of eqs. (1), (2).

Steering that keeps the centre of mass on a path of curvature κ leaves one degree of freedom: the
heading of the body. With θ̃ its heading relative to the path, ρ its yaw per distance and v its
speed, force and moment of both axles at the lateral acceleration v²κ give

    dθ̃/dt = v (ρ - κ),    dρ/dt = (m a v / I) κ - (ω²/v) (θ̃ + b ρ),    ω² = (a+b) C_r / I.

This is stable for any car (damping b ω²/v), so past curvature alone determines θ̃ and ρ. On an arc
they settle at θ̃ = -l κ and ρ = κ, where l = b - m a v²/((a+b) C_r) is
`steady_slip_per_curvature`. While κ changes by κ' per distance, they settle at

    θ̃ = -l κ + (b l - v²/ω²) κ',    ρ = κ - l κ'.

The steering angle is

    δ = m v² κ / C_f - (C_r/C_f) (θ̃ + b ρ) - θ̃ + a ρ,

on an arc the angle of eq. (6). At walking pace this becomes geometry: θ̃ relaxes over the distance
b, and δ = (a+b) ρ.

The speed v of eqs. (1), (2) is that along the body, cos θ̃ times that along the path. With tan θ̃ for
θ̃ and κ/cos θ̃ for κ the equations therefore also hold for large θ̃, except for a term of θ̃² dθ̃/dt.
On a radius of 8 m at walking pace κ/cos θ̃ exceeds κ by 2 %, and the steering angle grows by 0.4°.
Without this correction, feedback at the paper's gains leaves an offset of decimetres.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import WALKING_PACE

STEP: Final = 0.025
MIN_STEP: Final = 0.3
"""Time (s), or if longer the distance (m), between sampled curvatures. Not a usual control period,
so that the delay in seeing a jump of the curvature varies.
"""
MEMORY: Final = 0.35
MIN_MEMORY: Final = 3.0
"""Time (s), or if longer the distance (in units of b), after which past motion is ignored: it has
decayed to a tenth at 30 m/s, and further at lower speeds."""


class AlongPath(NamedTuple):
    """Samples of a quantity `step` (m) apart, the first one `start` (m) ahead of the car.

    A single value applies everywhere.
    """

    start: float
    step: float
    values: Sequence[float]

    def mean(self, distance: float, apart: float) -> float:
        """Mean at `distance` (m) ahead and `apart` (m) before and after, weights 1/4, 1/2, 1/4.

        It belongs to the path of mean curvature, as the motion is linear in the curvature. Values
        are interpolated, and constant beyond the ends.
        """
        start, step, values = self
        last, mean = len(values) - 1, 0.0
        if last == 0:
            return values[0]
        for ahead, share in ((distance - apart, 0.25), (distance + apart, 0.25), (distance, 0.5)):
            where = (ahead - start) / step
            if where <= 0.0 or where >= last:
                mean += share * values[0 if where <= 0.0 else last]
            else:
                index = int(where)
                value = values[index]
                mean += share * (value + (where - index) * (values[index + 1] - value))
        return mean


class PathMotion(NamedTuple):
    """Motion that follows a path exactly, by the inverse of eqs. (1), (2).

    Curvature κ/cos θ̃ (1/m), heading θ̃ relative to the path (rad), steering angle δ (rad).
    """

    curvature: AlongPath
    heading: AlongPath
    steering: AlongPath


Pair = tuple[float, float]


class PathKeeping:
    """Motion of one car that follows paths exactly: the inverse of eqs. (1), (2)."""

    def __init__(self, p: VehicleParameters) -> None:
        self._wheelbase = wheelbase = p.wheelbase
        self._steer_gradient = p.steer_gradient
        self._rear, self._moment = p.rear_axle_distance, p.mass * p.front_axle_distance
        self._stiffness = wheelbase * p.rear_cornering_stiffness
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
        """Motion that follows a path at constant `speed` (m/s), by the inverse of eqs. (1), (2).

        `curvatures(start, step, count)` returns the path's curvatures (1/m) from `start` (m) ahead
        of the car, `step` (m) apart. The motion covers `reach` (m ahead). Exact where the curvature
        is linear between samples.
        """
        v = max(speed, WALKING_PACE)
        step = max(STEP * v, MIN_STEP)
        first = math.floor(reach[0] / step)
        fading = math.ceil(max(MEMORY * v, MIN_MEMORY * self._rear) / step)
        count = fading + math.ceil(reach[1] / step) - first + 1
        sampled = curvatures((first - fading) * step, step, count)
        slip = self.slip(v)
        gradient = self._wheelbase + self._steer_gradient * v * v
        longer = 0.5 * slip * slip  # 1/cos θ̃ = 1 + (l κ)²/2, to fourth order
        kappa = sampled[0] + longer * sampled[0] ** 3
        kappas, headings, angles, start = [], [], [], first * step
        if sampled.count(sampled[0]) == count:  # an arc or a line
            kappas, headings, angles = [kappa], [math.atan(-slip * kappa)], [gradient * kappa]
        else:
            (keep, gain), (loss, rest), (of_heading, of_turn) = self._off_an_arc(step, v, slip)
            by_heading, by_turn = self._by_heading, self._by_turn
            heading = turn = 0.0  # θ̃ and ρ minus those of an arc of the same curvature
            for k, flat in enumerate(sampled[1:], 1):
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
        along = AlongPath(start, step, kappas), AlongPath(start, step, headings)
        return PathMotion(*along, AlongPath(start, step, angles))

    def _off_an_arc(self, step: float, v: float, slip: float) -> tuple[Pair, Pair, Pair]:
        """Propagation of θ̃ and ρ, minus those of an arc, over a `step` (m): eqs. (1), (2).

        Returns the rows of the matrix by which the differences decay, and the vector that a linear
        change of the curvature by 1 adds. `slip` is l.
        """
        square, b = self._square, self._rear
        (keep, gain), (loss, rest) = fading = _fading(step / v, v, square, b * square / v)
        heading, turn = (b * slip - v * v / square) / step, -slip / step
        response = (heading - keep * heading - gain * turn, turn - loss * heading - rest * turn)
        return *fading, response


def _fading(span: float, v: float, square: float, damping: float) -> tuple[Pair, Pair]:
    """Rows of the matrix by which a deviation (θ̃, ρ) decays in `span` (s): e^(At), eqs. (1), (2).

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
