"""Motion of the simulated car: single-track model with steering actuation (paper, Section II).

Lateral motion by eqs. (1), (2), steering by eq. (4), position by integrating the body's velocity.
World frame: east-north, yaw counter-clockwise from east; left is positive. SI units. This is for
linear tyres; the motion on saturating tyres is described below.

Integration: Runge-Kutta of order 4 with a constant command, in sub-steps h with
h * rate <= STEP_PER_RATE, where `rate` is the fastest rate of tyres and steering. Tolerance: over
an emergency lane change in spans of 20 ms the path stays within 0.005 mm of the exact solution.
After a steering step of 0.05 rad, lateral speed (m/s) and yaw rate (rad/s) are within 4e-4 of it.
At its rate limit the steering angle is within 5e-4 rad.

Below WALKING_PACE the tyres' 1/v would make the equations arbitrarily stiff. There, lateral speed
and yaw rate relax as fast as at WALKING_PACE (about 5 ms) to the steady state for the present
steering and speed. For v -> 0 this is the kinematic single-track model; it is continuous in v.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import (
    GRAVITY,
    WALKING_PACE,
    axle_loads,
    brush_force,
    lateral_coefficients,
    lateral_share,
)

STEP_PER_RATE: Final = 0.45  # Longest sub-step, in units of the shortest time constant
RATE_LIMITED_STEP: Final = 0.0025  # Longest sub-step (s) near the rate limit

Vector4 = tuple[float, float, float, float]


def actuator(p: VehicleParameters) -> tuple[float, float]:
    """Coefficients ω² and 2ζω of eq. (4), δ'' = ω² (δ_c - δ) - 2ζω δ'."""
    square = p.steering_frequency * p.steering_frequency
    return square, 2.0 * p.steering_damping * p.steering_frequency


# ---- Motion of the car on saturating tyres: a car that can slide, spin and brake up to friction
#
# The single-track model of Section II with its small angles, lateral forces of the brush model (see
# `tyres`), and the speed along the body as a state, so that a slide costs speed. With slip angles
# s_f = (v_y + a r)/v - δ, s_r = (v_y - b r)/v and the acceleration a_x of drive or brakes,
#
#     v'   = a_x + r v_y - F_f δ / m          F_f, F_r: brush forces at s_f and s_r
#     v_y' = (F_f + F_r) / m - r v
#     r'   = (a F_f - b F_r) / I,
#
# so that kinetic energy changes at the rate m a_x v + v (F_f s_f + F_r s_r): without drive it never
# grows. Cornering costs speed by the tyres' slip, 0.01 m/s² at 2 m/s² of lateral acceleration.
#
# The commanded acceleration acts without delay, up to friction, as in the paper. The car never
# rolls backwards: if it spins beyond a right angle to its path, it slides sideways until it stops.
#
# Below WALKING_PACE the slip speeds are divided by WALKING_PACE. For v -> 0 this is the kinematic
# single-track model; it is continuous in v, and braking is still limited by friction. The steering
# for a curvature is then L + K_sg v WALKING_PACE, within 0.1 % of eq. (6).
#
# Classical Runge-Kutta, sub-steps as for linear tyres. Tolerance over a span of 20 ms against the
# exact solution, in full slides and under braking: 0.1 mm in position, 0.01 m/s, 0.01 rad/s. The
# largest errors occur at the onset of sliding and at the stop; elsewhere they are a tenth of that.


Vector5 = tuple[float, float, float, float, float]
_Axles = tuple[float, ...]  # The brush model's constants at a longitudinal force, see `_axles`
_Rates = Callable[[float, float, float, float, _Axles], tuple[float, float, float]]


def _step(  # noqa: PLR0917 - every tick calls this
    rates: _Rates,
    axles: _Axles,
    position: Vector4,
    state: Vector5,
    command: float,
    drive: float,
    h: float,
    actuation: tuple[float, float],
) -> tuple[Vector4, Vector5]:
    """One Runge-Kutta step, written out because runs spend most of their time here.

    `position` is (east, north, yaw, distance), `state` is (speed, lateral speed, yaw rate,
    steering, steering rate). Its derivative at stage i is (ci + drive, ai, bi, wi, di).
    """
    square, damping = actuation
    (v1, y1, r1, s1, w1), half = state, 0.5 * h

    c1, a1, b1 = rates(v1, y1, r1, s1, axles)
    d1 = square * (command - s1) - damping * w1

    v2 = v1 + half * (c1 + drive)
    y2, r2, s2, w2 = y1 + half * a1, r1 + half * b1, s1 + half * w1, w1 + half * d1
    c2, a2, b2 = rates(v2, y2, r2, s2, axles)
    d2 = square * (command - s2) - damping * w2

    v3 = v1 + half * (c2 + drive)
    y3, r3, s3, w3 = y1 + half * a2, r1 + half * b2, s1 + half * w2, w1 + half * d2
    c3, a3, b3 = rates(v3, y3, r3, s3, axles)
    d3 = square * (command - s3) - damping * w3

    v4 = v1 + h * (c3 + drive)
    y4, r4, s4, w4 = y1 + h * a3, r1 + h * b3, s1 + h * w3, w1 + h * d3
    c4, a4, b4 = rates(v4, y4, r4, s4, axles)
    d4 = square * (command - s4) - damping * w4

    sixth = h / 6.0
    east, north, yaw, distance = position
    cos, sin, sqrt = math.cos, math.sin, math.sqrt
    q2, q3, q4 = yaw + half * r1, yaw + half * r2, yaw + h * r3
    k1, k2, k3, k4 = cos(yaw), cos(q2), cos(q3), cos(q4)
    z1, z2, z3, z4 = sin(yaw), sin(q2), sin(q3), sin(q4)
    eastward = (v1 * k1 - y1 * z1) + (v4 * k4 - y4 * z4)
    eastward += 2.0 * ((v2 * k2 - y2 * z2) + (v3 * k3 - y3 * z3))
    northward = (v1 * z1 + y1 * k1) + (v4 * z4 + y4 * k4)
    northward += 2.0 * ((v2 * z2 + y2 * k2) + (v3 * z3 + y3 * k3))
    along = sqrt(v1 * v1 + y1 * y1) + sqrt(v4 * v4 + y4 * y4)
    along += 2.0 * (sqrt(v2 * v2 + y2 * y2) + sqrt(v3 * v3 + y3 * y3))
    return (
        east + sixth * eastward,
        north + sixth * northward,
        yaw + sixth * (r1 + 2.0 * (r2 + r3) + r4),
        distance + sixth * along,
    ), (
        v1 + h * drive + sixth * (c1 + 2.0 * (c2 + c3) + c4),
        y1 + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        r1 + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        s1 + sixth * (w1 + 2.0 * (w2 + w3) + w4),
        w1 + sixth * (d1 + 2.0 * (d2 + d3) + d4),
    )


def _brush_rates(
    v: float, y: float, r: float, s: float, axles: _Axles
) -> tuple[float, float, float]:
    """Derivatives of speed (without drive), lateral speed and yaw rate on the brush model."""
    a, b, turn_front, turn_rear, front, most_front, front_bend, rear, most_rear, rear_bend = axles
    rolling = v if v > WALKING_PACE else WALKING_PACE
    slip = (y + a * r - v * s) / rolling
    x = front_bend * slip if slip > 0.0 else -front_bend * slip
    if x < 1.0:
        f = -front * slip * (1.0 - x * (1.0 - x / 3.0))
    else:
        f = -most_front if slip > 0.0 else most_front
    slip = (y - b * r) / rolling
    x = rear_bend * slip if slip > 0.0 else -rear_bend * slip
    if x < 1.0:
        g = -rear * slip * (1.0 - x * (1.0 - x / 3.0))
    else:
        g = -most_rear if slip > 0.0 else most_rear
    return r * y - f * s, f + g - r * v, turn_front * f - turn_rear * g


# ---- Dynamics


FASTEST_SLIDE: Final = 1000.0  # Limit of the lateral speed (m/s) of an unstable car


class OutOfModelError(ValueError):
    """The motion of the car is beyond the model, eqs. (1), (2)."""


@dataclass(slots=True)
class Body:
    """State of the car in eqs. (1), (2) and (4), and its position.

    east, north (m) of the centre of mass; yaw (rad, not wrapped); speed and lateral_speed (m/s)
    along and across the body; yaw_rate (rad/s); steering (rad) and steering_rate (rad/s) at the
    road wheels; distance (m) that the centre of mass has travelled along its own path.
    """

    east: float
    north: float
    yaw: float
    speed: float
    lateral_speed: float = 0.0
    yaw_rate: float = 0.0
    steering: float = 0.0
    steering_rate: float = 0.0
    distance: float = 0.0


@dataclass(slots=True)
class Actuation:
    """Command to the car: δ_c of eq. (4) (rad at the road wheels), acceleration (m/s²).

    The latter is the paper's dv_x/dt (Section IV-A), without delay unless the car has a drive lag.
    """

    steering: float
    acceleration: float


def achieved_acceleration(before: float, command: float, span: float, lag: float) -> float:
    """Acceleration (m/s²) at the end of `span` (s) with a constant command, from that before.

    Exact solution of the first-order lag, lag da/dt + a = command, the drive model of Plexe.
    """
    if lag == 0.0:
        return command
    return command + (before - command) * math.exp(-span / lag)


class DriveTrain:
    """The acceleration that follows commands with a first-order lag (s); 0 of a standing car."""

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self._acceleration = 0.0

    def act(self, command: Actuation, body: Body, span: float) -> Actuation:
        """Command with the mean acceleration over the coming `span` (s), so that speeds are exact.

        Positions differ from the exact ones by at most 0.1 span² times the change of acceleration.
        """
        lag = self._lag
        if lag == 0.0 or span <= 0.0:
            return command
        wanted = command.acceleration
        before = 0.0 if body.speed <= 0.0 else self._acceleration
        after = achieved_acceleration(before, wanted, span, lag)
        self._acceleration = after
        return Actuation(command.steering, wanted + (before - after) * lag / span)


class CarMotion:
    """Motion of one car by eqs. (1), (2) and (4), on linear tyres or by the brush model."""

    def __init__(self, parameters: VehicleParameters) -> None:
        p = self._parameters = parameters
        self._free = actuator(p)
        self._steering_limit, self._rate_limit = p.steering_limit, p.steering_rate_limit
        self._tyres = lateral_coefficients(p)
        self._saturates = p.tyres == "brush"
        damping = p.steering_damping
        overdamped = damping + math.sqrt(damping * damping - 1.0) if damping > 1.0 else 1.0
        self._steering_rate = overdamped * p.steering_frequency
        self._tyres_damping = -min(self._tyres[0], self._tyres[4])
        self._grip = p.friction * GRAVITY if self._saturates else math.inf

    def advance(self, body: Body, actuation: Actuation, span: float) -> Body:
        """Move the car by `span` (s) with constant `actuation`; classical Runge–Kutta method.

        Command and angle of the steering are clamped to the steering limit. A braking car stops
        and never reverses. Raises ValueError for a command that is not finite or a negative span,
        and OutOfModelError for a divergent spin of an unstable car.
        """
        command, acceleration = actuation.steering, actuation.acceleration
        if not (math.isfinite(command) and math.isfinite(acceleration)):
            raise ValueError(f"a command must be finite: {actuation}")
        if not 0.0 <= span < math.inf:
            raise ValueError(f"a span must be finite and not negative: {span}")
        limit = self._steering_limit
        command = -limit if command < -limit else limit if command > limit else command
        if self._saturates:
            return self._move(body, command, acceleration, span)
        if body.speed + acceleration * span >= 0.0:
            moved = self._move(body, command, acceleration, span)
        else:
            rolling = -body.speed / acceleration
            stopped = replace(self._move(body, command, acceleration, rolling), speed=0.0)
            moved = self._move(stopped, command, 0.0, span - rolling)
        if not abs(moved.lateral_speed) < FASTEST_SLIDE:
            raise OutOfModelError(f"the car spins: it is unstable at {moved.speed:.1f} m/s")
        return moved

    def fastest_rate(self, speed: float) -> float:
        """Fastest rate (1/s) at `speed` (m/s): damping of eqs. (1), (2), or pole of eq. (4)."""
        of_tyres, of_steering = self._tyres_damping / speed, self._steering_rate
        return of_steering if of_steering > of_tyres else of_tyres

    def _substeps(self, span: float, slowest: float, off: float, rate: float) -> tuple[int, bool]:
        """Count the sub-steps of a span (s), and check whether the rate limit may be reached.

        `slowest` is the lowest speed (m/s) in it, `off` the command minus the steering angle (rad),
        `rate` that of the steering (rad/s). Uses an upper bound of the rate by eq. (4).
        """
        slowest = WALKING_PACE if slowest < WALKING_PACE else slowest
        count = math.ceil(span * self.fastest_rate(slowest) / STEP_PER_RATE)
        (square, damping), fast = self._free, abs(rate)
        if fast + span * (square * abs(off) + damping * fast) < self._rate_limit:
            return count, False
        return max(count, math.ceil(span / RATE_LIMITED_STEP)), True

    def _actuation(self, off: float, rate: float) -> tuple[float, float]:
        """Coefficients of eq. (4), 0 where it would accelerate steering that is at its rate limit.

        `off` is the command minus the angle (rad), `rate` in rad/s.
        """
        square, damping = self._free
        held = abs(rate) >= self._rate_limit and (square * off - damping * rate) * rate > 0.0
        return (0.0, 0.0) if held else self._free

    def _clamped(self, angle: float, rate: float) -> tuple[float, float]:
        """Clamp angle (rad) and rate (rad/s) of eq. (4) to the limits of the steering rack."""
        if abs(angle) > self._steering_limit:  # the rack's end stop
            return math.copysign(self._steering_limit, angle), 0.0
        if abs(rate) > self._rate_limit:
            return angle, math.copysign(self._rate_limit, rate)
        return angle, rate

    def _move(self, body: Body, command: float, acceleration: float, span: float) -> Body:
        """Move the car by `span` (s), with up to the acceleration (m/s²) that friction allows."""
        if span <= 0.0:
            return body
        # In a slide the rotation of the body also changes the speed along it.
        turning = body.yaw_rate * body.lateral_speed if self._saturates else 0.0
        gained = span * (acceleration + turning)
        slowest = body.speed + gained if gained < 0.0 else body.speed
        off, rate = command - body.steering, body.steering_rate
        count, near_limit = self._substeps(span, slowest, off, rate)
        grip, h, free = self._grip, span / count, self._free
        given = -grip if acceleration < -grip else grip if acceleration > grip else acceleration
        drive = given if body.speed > 0.0 or given > 0.0 else 0.0
        rates = _brush_rates if self._saturates else self._linear_rates
        axles = self._axles(drive) if self._saturates else ()
        position: Vector4 = (body.east, body.north, body.yaw, body.distance)
        speed, lateral, yaw_rate = body.speed, body.lateral_speed, body.yaw_rate
        steering = body.steering
        for _ in range(count):
            actuation = self._actuation(command - steering, rate) if near_limit else free
            state = speed, lateral, yaw_rate, steering, rate
            position, (speed, lateral, yaw_rate, steering, rate) = _step(
                rates, axles, position, state, command, drive, h, actuation
            )
            if abs(steering) > self._steering_limit or abs(rate) > self._rate_limit:
                steering, rate = self._clamped(steering, rate)
            speed = speed if speed > 0.0 else 0.0  # the car does not roll backwards
            possible = given if speed > 0.0 or given > 0.0 else 0.0
            if possible != drive:
                drive, axles = possible, self._axles(possible)
        east, north, yaw, distance = position
        return Body(east, north, yaw, speed, lateral, yaw_rate, steering, rate, distance)

    def _axles(self, drive: float) -> _Axles:
        """Lever arms, and for each axle C/m, capacity/m, C/(3 capacity), at a `drive` (m/s²)."""
        p = self._parameters
        a, b, per_inertia = p.front_axle_distance, p.rear_axle_distance, p.mass / p.yaw_inertia
        front, rear = p.front_cornering_stiffness / p.mass, p.rear_cornering_stiffness / p.mass
        left = self._grip * lateral_share(drive, p.friction) / (a + b)
        most_front, most_rear = left * b, left * a
        # Without friction left, any slip is full sliding.
        front_bend = front / (3.0 * most_front) if most_front > 0.0 else math.inf
        rear_bend = rear / (3.0 * most_rear) if most_rear > 0.0 else math.inf
        return (
            *(a, b, a * per_inertia, b * per_inertia),
            *(front, most_front, front_bend, rear, most_rear, rear_bend),
        )

    def _linear_rates(
        self, v: float, y: float, r: float, s: float, axles: _Axles
    ) -> tuple[float, float, float]:
        """Derivatives of lateral speed and yaw rate on linear tyres; 0 for the speed.

        Below WALKING_PACE the column of the steering gives the equilibrium of the present speed.
        """
        a, b, c, d, e, f = self._tyres
        rolling = v if v > WALKING_PACE else WALKING_PACE
        vv, vr, rv, rr = a / rolling, b / rolling - rolling, d / rolling, e / rolling
        if v < WALKING_PACE:
            p = self._parameters
            yaw_gain = v / (p.wheelbase + p.steer_gradient * v * v)
            slip_gain = p.steady_slip_per_curvature(v) * yaw_gain
            c, f = -(vv * slip_gain + vr * yaw_gain), -(rv * slip_gain + rr * yaw_gain)
        return 0.0, vv * y + vr * r + c * s, rv * y + rr * r + f * s


def fastest_rate(p: VehicleParameters) -> float:
    """Fastest rate (1/s) of tyres and steering over all speeds: that at WALKING_PACE."""
    return CarMotion(p).fastest_rate(WALKING_PACE)


# ---- Use of the tyres


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


def tyre_use(
    state: Body,
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


def rolling_use(state: Body, p: VehicleParameters) -> TyreUse:
    """Tyre use of a car that rolls without slip, for recorded motion, which has no simulated tyres.

    Lateral acceleration v_x dθ/dt of eq. (1), and the share of friction that it needs.
    """
    across = state.speed * state.yaw_rate
    return TyreUse(across, 0.0, 0.0, abs(across) / (p.friction * GRAVITY))
