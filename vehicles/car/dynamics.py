"""Motion of the simulated car: single-track model with steering actuation (paper, Section II).

Lateral motion by eqs. (1), (2) in the body's lateral speed and yaw rate, steering by the
second-order actuation of eq. (4), position by integrating the body's velocity. World frame:
east-north, yaw counter-clockwise from east; left is positive. SI units. This is for linear tyres;
for saturating tyres see `BrushMotion`.

Integration: Runge-Kutta of order 4 with a constant command, in sub-steps h with
h * rate <= STEP_PER_RATE, where `rate` is the fastest rate of tyres and steering. Tolerance: over
an emergency lane change in spans of 20 ms the path stays within 0.005 mm of the exact solution.
After a steering step of 0.05 rad, lateral speed (m/s) and yaw rate (rad/s) are within 4e-4 of it.
At its rate limit the steering angle is within 5e-4 rad.

Below WALKING_PACE the tyres' 1/v would make the equations arbitrarily stiff. There, lateral speed
and yaw rate relax as fast as at WALKING_PACE (about 5 ms) to the steady state for the present
steering and speed. For v -> 0 this is the kinematic single-track model. The right-hand side is
continuous in v.
"""

import math
from dataclasses import dataclass
from typing import Final

from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import (
    GRAVITY,
    WALKING_PACE,
    Coefficients,
    lateral_coefficients,
    lateral_share,
)

# ---- Integration shared by both tyre models: position, steering limits, and step length
#
# World frame: east-north, yaw counter-clockwise from east. SI units.


STEP_PER_RATE: Final = 0.45  # Longest sub-step, in units of the shortest time constant
RATE_LIMITED_STEP: Final = 0.0025  # Longest sub-step (s) near the rate limit

Vector4 = tuple[float, float, float, float]


def integrate_position(
    position: Vector4, speeds: Vector4, lateral_speeds: Vector4, yaw_rates: Vector4, h: float
) -> Vector4:
    """Integrate (east, north, yaw, distance) over h (s), by the classical Runge–Kutta method.

    The other arguments hold the values at its four stages: speeds along and across the body (m/s)
    and yaw rate (rad/s).
    """
    east, north, yaw, distance = position
    (v1, v2, v3, v4), (y1, y2, y3, y4), (r1, r2, r3, r4) = speeds, lateral_speeds, yaw_rates
    cos, sin, sqrt, half = math.cos, math.sin, math.sqrt, 0.5 * h
    q2, q3, q4 = yaw + half * r1, yaw + half * r2, yaw + h * r3
    k1, k2, k3, k4 = cos(yaw), cos(q2), cos(q3), cos(q4)
    z1, z2, z3, z4 = sin(yaw), sin(q2), sin(q3), sin(q4)
    sixth = h / 6.0
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
    )


def actuator(p: VehicleParameters) -> tuple[float, float]:
    """Coefficients ω² and 2ζω of eq. (4), δ'' = ω² (δ_c - δ) - 2ζω δ'."""
    square = p.steering_frequency * p.steering_frequency
    return square, 2.0 * p.steering_damping * p.steering_frequency


class Steering:
    """Steering of one car by eq. (4), with limits of angle and rate."""

    def __init__(self, p: VehicleParameters) -> None:
        self.free = actuator(p)
        self.limit = p.steering_limit
        self.rate_limit = p.steering_rate_limit

    def substeps(self, span: float, off: float, rate: float) -> int:
        """Count the sub-steps of a span (s) in which the rate limit may be reached; 0 if it is not.

        `off` is the command minus the angle (rad), `rate` in rad/s. Uses an upper bound of the rate
        by eq. (4).
        """
        square, damping = self.free
        fast = abs(rate)
        if fast + span * (square * abs(off) + damping * fast) < self.rate_limit:
            return 0
        return math.ceil(span / RATE_LIMITED_STEP)

    def is_at_rate_limit(self, off: float, rate: float) -> bool:
        """Whether the steering is at its rate limit and eq. (4) would accelerate it further.

        `off` is the command minus the angle (rad), `rate` in rad/s.
        """
        if abs(rate) < self.rate_limit:
            return False
        square, damping = self.free
        return (square * off - damping * rate) * rate > 0.0

    def clamped(self, angle: float, rate: float) -> tuple[float, float]:
        """Clamp angle (rad) and rate (rad/s) of eq. (4) to the limits of the steering rack."""
        if abs(angle) > self.limit:  # the rack's end stop
            return math.copysign(self.limit, angle), 0.0
        if abs(rate) > self.rate_limit:
            return angle, math.copysign(self.rate_limit, rate)
        return angle, rate


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
# Classical Runge-Kutta, sub-steps as in `dynamics`. Tolerance over a span of 20 ms against the
# exact solution, in full slides and under braking: 0.1 mm in position, 0.01 m/s, 0.01 rad/s. The
# largest errors occur at the onset of sliding and at the stop; elsewhere they are a tenth of that.


Vector5 = tuple[float, float, float, float, float]
_Tyres = tuple[float, float, float, float, float, float, float, float, float, float]


class BrushMotion:
    """Motion of one car with the brush model (Section II)."""

    def __init__(self, p: VehicleParameters, steering: Steering) -> None:
        self._steering = steering
        self._friction = p.friction
        self._limit = p.friction * GRAVITY
        self._wheelbase = p.wheelbase
        self._front_arm, self._rear_arm = p.front_axle_distance, p.rear_axle_distance
        self._front = p.front_cornering_stiffness / p.mass
        self._rear = p.rear_cornering_stiffness / p.mass
        self._per_inertia = p.mass / p.yaw_inertia

    def move(  # noqa: PLR0917 - keyword arguments are slower, and every tick calls this
        self,
        position: Vector4,
        state: Vector5,
        command: float,
        acceleration: float,
        span: float,
        fastest: float,
        substeps: int | None = None,
    ) -> tuple[Vector4, Vector5]:
        """Move the car by `span` (s) with constant steering command (rad) and acceleration (m/s²).

        Section II with the brush model, by the classical Runge–Kutta method. `position` is (east,
        north, yaw, distance), `state` is (speed, lateral speed, yaw rate, steering, steering rate);
        `fastest` is the fastest rate (1/s) of tyres and steering at the lowest speed of the span.
        """
        limit, wheels = self._limit, self._steering
        given = -limit if acceleration < -limit else limit if acceleration > limit else acceleration
        near_limit = wheels.substeps(span, command - state[3], state[4])
        needed = math.ceil(span * fastest / STEP_PER_RATE)
        count = substeps or (near_limit if near_limit > needed else needed)
        h = span / count
        rolls = state[0] > 0.0 or given > 0.0
        drive = given if rolls else 0.0
        tyres = self._tyres(drive)
        for _ in range(count):
            held = near_limit and wheels.is_at_rate_limit(command - state[3], state[4])
            actuation = (0.0, 0.0) if held else wheels.free
            position, state = _brush_step(position, state, command, drive, h, tyres, actuation)
            speed, lateral, yaw_rate, steering, rate = state
            if abs(steering) > wheels.limit or abs(rate) > wheels.rate_limit:
                steering, rate = wheels.clamped(steering, rate)
                state = (speed, lateral, yaw_rate, steering, rate)
            if speed <= 0.0:  # the car does not roll backwards
                state = (0.0, lateral, yaw_rate, steering, rate)
            if (state[0] > 0.0 or given > 0.0) != rolls:
                rolls = not rolls
                drive = given if rolls else 0.0
                tyres = self._tyres(drive)
        return position, state

    def _tyres(self, drive: float) -> _Tyres:
        """Lever arms, and for each axle C/m, capacity/m, C/(3 capacity), at a `drive` (m/s²)."""
        a, b, front, rear = self._front_arm, self._rear_arm, self._front, self._rear
        left = self._limit * lateral_share(drive, self._friction) / self._wheelbase
        most_front, most_rear = left * b, left * a
        # Without friction left, any slip is full sliding.
        front_bend = front / (3.0 * most_front) if most_front > 0.0 else math.inf
        rear_bend = rear / (3.0 * most_rear) if most_rear > 0.0 else math.inf
        return (
            *(a, b, a * self._per_inertia, b * self._per_inertia),
            *(front, most_front, front_bend, rear, most_rear, rear_bend),
        )


def _rates(v: float, y: float, r: float, s: float, tyres: _Tyres) -> tuple[float, float, float]:
    """Derivatives of speed (without drive), lateral speed and yaw rate."""
    a, b, turn_front, turn_rear, front, most_front, front_bend, rear, most_rear, rear_bend = tyres
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


def _brush_step(  # noqa: PLR0917 - as above
    position: Vector4,
    state: Vector5,
    command: float,
    drive: float,
    h: float,
    tyres: _Tyres,
    actuation: tuple[float, float],
) -> tuple[Vector4, Vector5]:
    """One Runge-Kutta step; the derivative of the state at stage i is (ci, ai, bi, wi, di)."""
    square, damping = actuation
    (v1, y1, r1, s1, w1), half = state, 0.5 * h

    c1, a1, b1 = _rates(v1, y1, r1, s1, tyres)
    d1 = square * (command - s1) - damping * w1

    v2, y2, r2 = v1 + half * (c1 + drive), y1 + half * a1, r1 + half * b1
    s2, w2 = s1 + half * w1, w1 + half * d1
    c2, a2, b2 = _rates(v2, y2, r2, s2, tyres)
    d2 = square * (command - s2) - damping * w2

    v3, y3, r3 = v1 + half * (c2 + drive), y1 + half * a2, r1 + half * b2
    s3, w3 = s1 + half * w2, w1 + half * d2
    c3, a3, b3 = _rates(v3, y3, r3, s3, tyres)
    d3 = square * (command - s3) - damping * w3

    v4, y4, r4, s4, w4 = v1 + h * (c3 + drive), y1 + h * a3, r1 + h * b3, s1 + h * w3, w1 + h * d3
    c4, a4, b4 = _rates(v4, y4, r4, s4, tyres)
    d4 = square * (command - s4) - damping * w4

    sixth = h / 6.0
    return integrate_position(position, (v1, v2, v3, v4), (y1, y2, y3, y4), (r1, r2, r3, r4), h), (
        v1 + h * drive + sixth * (c1 + 2.0 * (c2 + c3) + c4),
        y1 + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        r1 + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        s1 + sixth * (w1 + 2.0 * (w2 + w3) + w4),
        w1 + sixth * (d1 + 2.0 * (d2 + d3) + d4),
    )


# ---- Dynamics


FASTEST_SLIDE: Final = 1000.0  # Limit of the lateral speed (m/s) of an unstable car

_Lateral = tuple[float, float, float, float, float, float]


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

    The acceleration is the paper's dv_x/dt (Section IV-A), which acts without delay, unless the
    car has a drive lag.
    """

    steering: float
    acceleration: float


def achieved_acceleration(before: float, command: float, span: float, lag: float) -> float:
    """Acceleration (m/s²) at the end of `span` (s) with a constant command, from that before.

    The exact solution of the first-order lag, lag da/dt + a = command, which is the drive model of
    Plexe; with a lag of 0 s the command.
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

        Within the span a position differs from the exact one by at most 0.1 times the change of
        acceleration times the square of the span.
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
    """Motion of one car by eqs. (1), (2) and (4)."""

    def __init__(self, parameters: VehicleParameters) -> None:
        p = self._parameters = parameters
        self._steering = Steering(p)
        self._tyres = lateral_coefficients(p)
        self._saturates = p.tyres == "brush"
        self._brushes = BrushMotion(p, self._steering)
        damping = p.steering_damping
        overdamped = damping + math.sqrt(damping * damping - 1.0) if damping > 1.0 else 1.0
        self._steering_rate = overdamped * p.steering_frequency
        self._tyres_damping = -min(self._tyres[0], self._tyres[4])

    def advance(
        self, body: Body, actuation: Actuation, span: float, substeps: int | None = None
    ) -> Body:
        """Move the car by `span` (s) with constant `actuation`; classical Runge–Kutta method.

        Command and angle of the steering are clamped to the steering limit. A braking car stops
        and never reverses. `substeps` overrides the number of integration steps (before and after
        the stop). Raises ValueError for a command that is not finite or a negative span, and
        OutOfModelError for a divergent spin of an unstable car.
        """
        command, acceleration = actuation.steering, actuation.acceleration
        if not (math.isfinite(command) and math.isfinite(acceleration)):
            raise ValueError(f"a command must be finite: {actuation}")
        if not 0.0 <= span < math.inf:
            raise ValueError(f"a span must be finite and not negative: {span}")
        limit = self._steering.limit
        command = -limit if command < -limit else limit if command > limit else command
        if self._saturates:
            return self._advance_on_brushes(body, command, acceleration, span, substeps)
        final_speed = body.speed + acceleration * span
        if final_speed >= 0.0:
            return self._integrate(body, command, final_speed, span, substeps)
        rolling = -body.speed / acceleration
        stopped = self._integrate(body, command, 0.0, rolling, substeps)
        return self._integrate(stopped, command, 0.0, span - rolling, substeps)

    def fastest_rate(self, speed: float) -> float:
        """Fastest rate (1/s) at `speed` (m/s): damping of eqs. (1), (2), or pole of eq. (4)."""
        of_tyres, of_steering = self._tyres_damping / speed, self._steering_rate
        return of_steering if of_steering > of_tyres else of_tyres

    def _advance_on_brushes(
        self, body: Body, command: float, acceleration: float, span: float, substeps: int | None
    ) -> Body:
        if span <= 0.0:
            return body
        # In a slide the rotation of the body also changes the speed along it.
        gained = span * (acceleration + body.yaw_rate * body.lateral_speed)
        slowest = body.speed + gained if gained < 0.0 else body.speed
        slowest = WALKING_PACE if slowest < WALKING_PACE else slowest
        position, state = self._brushes.move(
            (body.east, body.north, body.yaw, body.distance),
            (body.speed, body.lateral_speed, body.yaw_rate, body.steering, body.steering_rate),
            command,
            acceleration,
            span,
            self.fastest_rate(slowest),
            substeps,
        )
        east, north, yaw, distance = position
        speed, lateral, yaw_rate, steering, rate = state
        return Body(east, north, yaw, speed, lateral, yaw_rate, steering, rate, distance)

    def _integrate(
        self, body: Body, command: float, final_speed: float, span: float, substeps: int | None
    ) -> Body:
        """Advance on linear tyres while the speed changes linearly to `final_speed` (m/s)."""
        if span <= 0.0:
            return body
        p, tyres, wheels = self._parameters, self._tyres, self._steering
        near_limit = wheels.substeps(span, command - body.steering, body.steering_rate)
        fastest = self.fastest_rate(max(min(body.speed, final_speed), WALKING_PACE))
        count = substeps or max(math.ceil(span * fastest / STEP_PER_RATE), near_limit)
        position = (body.east, body.north, body.yaw, body.distance)
        state = (body.lateral_speed, body.yaw_rate, body.steering, body.steering_rate)
        speed, change = body.speed, (final_speed - body.speed) / count
        before = middle = after = _lateral_rates(speed, tyres, p)
        for index in range(count):
            faster = body.speed + change * (index + 1)
            speeds = (speed, 0.5 * (speed + faster), faster)
            if change != 0.0:
                middle = _lateral_rates(speeds[1], tyres, p)
                after = _lateral_rates(faster, tyres, p)
            held = near_limit and wheels.is_at_rate_limit(command - state[2], state[3])
            position, state = _step(
                position, state, speeds, (before, middle, after), command=command, h=span / count,
                actuation=(0.0, 0.0) if held else wheels.free,
            )  # fmt: skip
            if abs(state[2]) > wheels.limit or abs(state[3]) > wheels.rate_limit:
                state = (state[0], state[1], *wheels.clamped(state[2], state[3]))
            speed, before = faster, after
        if not abs(state[0]) < FASTEST_SLIDE:
            raise OutOfModelError(f"the car spins: it is unstable at {final_speed:.1f} m/s")
        return Body(position[0], position[1], position[2], final_speed, *state, position[3])


def fastest_rate(p: VehicleParameters) -> float:
    """Fastest rate (1/s) of tyres and steering over all speeds: that at WALKING_PACE."""
    return CarMotion(p).fastest_rate(WALKING_PACE)


def _lateral_rates(speed: float, tyres: Coefficients, p: VehicleParameters) -> _Lateral:
    """Coefficients (a, b, c, d, e, f) of v_y' = a v_y + b r + c delta, r' = d v_y + e r + f delta.

    Below WALKING_PACE the matrix is that at WALKING_PACE, and the column of the steering gives the
    equilibrium of the present speed.
    """
    v = max(speed, WALKING_PACE)
    a, b, c, d, e, f = tyres
    vv, vr, rv, rr = a / v, b / v - v, d / v, e / v
    if speed >= WALKING_PACE:
        return vv, vr, c, rv, rr, f
    yaw_gain = speed / (p.wheelbase + p.steer_gradient * speed * speed)
    slip_gain = p.steady_slip_per_curvature(speed) * yaw_gain
    return (
        *(vv, vr, -(vv * slip_gain + vr * yaw_gain)),
        *(rv, rr, -(rv * slip_gain + rr * yaw_gain)),
    )


def _step(
    position: Vector4,
    state: Vector4,
    speeds: tuple[float, float, float],
    rates: tuple[_Lateral, _Lateral, _Lateral],
    *,
    command: float,
    h: float,
    actuation: tuple[float, float],
) -> tuple[Vector4, Vector4]:
    """One Runge-Kutta step, written out because runs spend most of their time here.

    `position` is (east, north, yaw, distance), `state` is (lateral speed, yaw rate, steering,
    steering rate). Speeds and rates are those at the start, the middle and the end of the step.
    The derivative of the state at stage i is (ai, bi, wi, di).
    """
    square, damping = actuation
    (y1, r1, s1, w1), half = state, 0.5 * h

    vv, vr, vs, rv, rr, rs = rates[0]
    a1, b1 = vv * y1 + vr * r1 + vs * s1, rv * y1 + rr * r1 + rs * s1
    d1 = square * (command - s1) - damping * w1

    vv, vr, vs, rv, rr, rs = rates[1]
    y2, r2, s2, w2 = y1 + half * a1, r1 + half * b1, s1 + half * w1, w1 + half * d1
    a2, b2 = vv * y2 + vr * r2 + vs * s2, rv * y2 + rr * r2 + rs * s2
    d2 = square * (command - s2) - damping * w2

    y3, r3, s3, w3 = y1 + half * a2, r1 + half * b2, s1 + half * w2, w1 + half * d2
    a3, b3 = vv * y3 + vr * r3 + vs * s3, rv * y3 + rr * r3 + rs * s3
    d3 = square * (command - s3) - damping * w3

    vv, vr, vs, rv, rr, rs = rates[2]
    y4, r4, s4, w4 = y1 + h * a3, r1 + h * b3, s1 + h * w3, w1 + h * d3
    a4, b4 = vv * y4 + vr * r4 + vs * s4, rv * y4 + rr * r4 + rs * s4
    d4 = square * (command - s4) - damping * w4

    sixth = h / 6.0
    (v1, v2, v4) = speeds
    return integrate_position(position, (v1, v2, v2, v4), (y1, y2, y3, y4), (r1, r2, r3, r4), h), (
        y1 + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        r1 + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        s1 + sixth * (w1 + 2.0 * (w2 + w3) + w4),
        w1 + sixth * (d1 + 2.0 * (d2 + d3) + d4),
    )
