"""Tyres: lateral forces, axle loads, and the range of the linear model.

There are two models of an axle. In the paper's (Section II) the force is proportional to the slip
angle, without limit. In the brush model it is the same for small slip, and limited to friction
times load (E. Fiala, "Seitenkräfte am rollenden Luftreifen", VDI-Zeitschrift 96, 1954; H. B.
Pacejka, "Tyre and Vehicle Dynamics", 3.2). With longitudinal force the limit is the friction circle
(R. Y. Hindiyeh, J. C. Gerdes, "A controller framework for autonomous drifting", ASME Journal of
Dynamic Systems, Measurement, and Control 136(5), 2014).

Axle loads are those of the standing car: braking and cornering transfer no load. Drive and brake
forces are distributed like the load, so both axles have the same share of friction left for
cornering. SI units; left is positive.
"""

import math
from typing import Final

from vehicles.car.parameters import VehicleParameters

GRAVITY: Final = 9.80665  # Standard gravity (m/s²)
WALKING_PACE: Final = 2.0  # Lower bound (m/s) of the speed that divides slip speeds

NONLINEAR_SLIP = 0.5 * (3.0 - math.sqrt(6.6))
"""End of the linear range: slip, as a share of that of full sliding, at which the force of the
brush model is 20 % below C s. The root of 1 - x + x²/3 = 0.8, at 52 % of the friction."""

SLIDING_SHARE: Final = 0.99  # Share of friction in use above which an axle counts as sliding
Coefficients = tuple[float, float, float, float, float, float]  # A to F of `lateral_coefficients`


def lateral_coefficients(p: VehicleParameters) -> Coefficients:
    """Coefficients of eqs. (1), (2) solved for the derivatives, without the speed.

    v_y' = (A v_y + B r) / v - v r + C delta and r' = (D v_y + E r) / v + F delta.
    """
    front, rear = p.front_cornering_stiffness, p.rear_cornering_stiffness
    a, b, mass, inertia = p.front_axle_distance, p.rear_axle_distance, p.mass, p.yaw_inertia
    coupling = a * front - b * rear
    return (
        *(-(front + rear) / mass, -coupling / mass, front / mass),
        *(-coupling / inertia, -(a * a * front + b * b * rear) / inertia, a * front / inertia),
    )


def axle_loads(p: VehicleParameters) -> tuple[float, float]:
    """Loads (N) of front and rear axle of the standing car, by the centre of mass of Table I."""
    weight, wheelbase = p.mass * GRAVITY, p.wheelbase
    return weight * p.rear_axle_distance / wheelbase, weight * p.front_axle_distance / wheelbase


def brush_force(slip: float, stiffness: float, capacity: float) -> float:
    """Lateral force (N) of an axle at a slip angle (rad), by the brush model: Fiala, 1954.

    F = -C s (1 - x + x²/3) with x = C |s| / (3 capacity), and -capacity sgn(s) for x >= 1;
    `stiffness` C in N/rad, `capacity` in N, the force of full sliding.
    """
    share = stiffness * abs(slip)
    if share >= 3.0 * capacity:
        return -math.copysign(capacity, slip)
    x = share / (3.0 * capacity)
    return -stiffness * slip * (1.0 - x * (1.0 - x / 3.0))


def lateral_share(acceleration: float, friction: float) -> float:
    """Share of friction left for lateral force at a longitudinal acceleration (m/s²).

    Friction circle, Hindiyeh and Gerdes, 2014.
    """
    used = acceleration / (friction * GRAVITY)
    left = 1.0 - used * used
    return 0.0 if left < 0.0 else math.sqrt(left)


def linear_range(p: VehicleParameters) -> tuple[float, float]:
    """Slip angles (rad) of front and rear axle up to which eqs. (1), (2) hold on a real road.

    At these angles the brush model (Fiala, 1954) with the friction of `p` has 20 % less force than
    the linear tyre, without longitudinal force.
    """
    front, rear = axle_loads(p)
    reach = 3.0 * NONLINEAR_SLIP * p.friction
    return reach * front / p.front_cornering_stiffness, reach * rear / p.rear_cornering_stiffness
