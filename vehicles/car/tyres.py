"""Tyres: slip angles, lateral forces, and the share of friction in use.

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
from typing import Final, NamedTuple, Protocol

from vehicles.car.parameters import VehicleParameters

GRAVITY: Final = 9.80665  # Standard gravity (m/s²)
WALKING_PACE: Final = 2.0  # Lower bound (m/s) of the speed that divides slip speeds

NONLINEAR_SLIP = 0.5 * (3.0 - math.sqrt(6.6))
"""End of the linear range: slip, as a share of that of full sliding, at which the force of the
brush model is 20 % below C s. The root of 1 - x + x²/3 = 0.8, at 52 % of the friction."""

SLIDING_SHARE: Final = 0.99  # Share of friction in use above which an axle counts as sliding


class LateralState(Protocol):
    """State of the car in eqs. (1), (2) and (4), such as `dynamics.Body`."""

    speed: float
    lateral_speed: float
    yaw_rate: float
    steering: float


Coefficients = tuple[float, float, float, float, float, float]  # A to F of `lateral_coefficients`


class TyreUse(NamedTuple):
    """State of the tyres of the single-track model (Section II) at an instant.

    Lateral acceleration (m/s²) across the body; slip angles of the axles (rad), as in eqs. (1),
    (2): negative in a left turn; share of friction in use at the more heavily used axle (ratio),
    above 1 only with linear tyres.
    """

    lateral_acceleration: float
    front_slip: float
    rear_slip: float
    friction_share: float


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


def tyre_use(
    state: LateralState,
    acceleration: float,
    p: VehicleParameters,
    loads: tuple[float, float] | None = None,
) -> TyreUse:
    """Tyre use in a state of eqs. (1), (2), at a commanded acceleration (m/s²).

    Uses the tyre model of `p`. Slip is divided by a speed of at least WALKING_PACE. A standing car
    uses no friction for braking. `loads` (N) of the axles may be passed in if they are known.
    """
    speed, across, yaw_rate = state.speed, state.lateral_speed, state.yaw_rate
    rolling = WALKING_PACE if speed < WALKING_PACE else speed
    # Speed along the steered wheels is not slip.
    front_slip = (across + (p.front_axle_distance * yaw_rate - speed * state.steering)) / rolling
    rear_slip = (across - p.rear_axle_distance * yaw_rate) / rolling
    along = acceleration if speed > 0.0 or acceleration > 0.0 else 0.0
    front_load, rear_load = loads or axle_loads(p)
    if p.tyres == "linear":
        front = -p.front_cornering_stiffness * front_slip
        rear = -p.rear_cornering_stiffness * rear_slip
    else:
        limit = p.friction * GRAVITY
        along = -limit if along < -limit else limit if along > limit else along
        left = p.friction * lateral_share(along, p.friction)
        front = brush_force(front_slip, p.front_cornering_stiffness, left * front_load)
        rear = brush_force(rear_slip, p.rear_cornering_stiffness, left * rear_load)
    used = max(abs(front) / front_load, abs(rear) / rear_load)
    share = math.hypot(used, along / GRAVITY) / p.friction
    front_angle, rear_angle = math.atan(front_slip), math.atan(rear_slip)  # large in a spin
    return TyreUse((front + rear) / p.mass, front_angle, rear_angle, share)


def rolling_use(state: LateralState, p: VehicleParameters) -> TyreUse:
    """Tyre use of a car that rolls without slip, for recorded motion, which has no simulated tyres.

    Lateral acceleration v_x dθ/dt of eq. (1), and the share of friction that it needs.
    """
    across = state.speed * state.yaw_rate
    return TyreUse(across, 0.0, 0.0, abs(across) / (p.friction * GRAVITY))


def linear_range(p: VehicleParameters) -> tuple[float, float]:
    """Slip angles (rad) of front and rear axle up to which eqs. (1), (2) hold on a real road.

    At these angles the brush model (Fiala, 1954) with the friction of `p` has 20 % less force than
    the linear tyre, without longitudinal force.
    """
    front, rear = axle_loads(p)
    reach = 3.0 * NONLINEAR_SLIP * p.friction
    return reach * front / p.front_cornering_stiffness, reach * rear / p.rear_cornering_stiffness
