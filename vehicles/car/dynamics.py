"""Motion of the simulated car: single-track model with steering actuation (paper, Section II).

Lateral motion by eqs. (1), (2) in the body's lateral speed and yaw rate, steering by the
second-order actuation of eq. (4), position by integrating the body's velocity. World frame:
east-north, yaw counter-clockwise from east; left is positive. SI units. This is for linear tyres;
for saturating tyres see `brush_motion`.

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

from vehicles.car.brush_motion import BrushMotion
from vehicles.car.integration import STEP_PER_RATE, Steering, Vector4, integrate_position
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import WALKING_PACE, Coefficients, lateral_coefficients

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
