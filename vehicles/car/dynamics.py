"""Motion of the simulated car: single-track model with steering actuation (paper, Section II).

Lateral motion by eqs. (1), (2) in the body's lateral speed and yaw rate, steering by the
second-order actuation of eq. (4), position by integrating the body's velocity. World frame:
east-north, yaw counter-clockwise from east; left is positive. SI units. So with linear tyres; on
such as saturate the car moves as `brush_motion` says.

Integration: Runge-Kutta of order 4 with the command held over the span, in sub-steps h with
h * rate <= STEP_PER_RATE, where `rate` is the fastest of the tyres' and the steering's. Stated
tolerance: over an emergency lane change in spans of 20 ms the path stays within 0.005 mm of the
exact solution; after a steering step of 0.05 rad lateral speed (m/s) and yaw rate (rad/s) are
within 4e-4 of it. While the steering turns as fast as it can its angle is within 5e-4 rad.

Below WALKING_PACE the tyres' 1/v would make the equations arbitrarily stiff. There the lateral
speed and yaw rate relax, as fast as they do at WALKING_PACE (some 5 ms), to the steady state that
the same equations have for the present steering and speed, which for v -> 0 is the kinematic
single-track model. The right-hand side is continuous in v, so nothing jumps at the change-over.
"""

import math
from dataclasses import dataclass

from vehicles.car import brush_motion
from vehicles.car.integration import (
    STEP_PER_RATE,
    Four,
    actuator,
    is_at_rate_limit,
    moved,
    steps_for_steering,
    stopped_at_limits,
)
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import WALKING_PACE, Coefficients, lateral_coefficients

FASTEST_SLIDE = 1000.0
"""Lateral speed (m/s) beyond which the linear tyres of an unstable car have long lost all sense."""

_Lateral = tuple[float, float, float, float, float, float]


class OutOfModelError(ValueError):
    """The car moves as the model, eqs. (1), (2), cannot describe any more."""


@dataclass(slots=True)
class Body:
    """State of the car at one instant, of eqs. (1), (2) and (4), and its place.

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

    The acceleration is the paper's dv_x/dt (Section IV-A), which acts without delay.
    """

    steering: float
    acceleration: float


def advance(
    body: Body,
    actuation: Actuation,
    span: float,
    parameters: VehicleParameters,
    substeps: int | None = None,
) -> Body:
    """Move the car on by `span` (s) with `actuation` held meanwhile.

    Eqs. (1), (2) and (4) by the classical Runge–Kutta method.

    The steering command is clamped to the steering limit and the wheels stop there. A braking car
    comes to rest within the span and stays; it never reverses. `substeps` overrides the number of
    integration steps (per part of the span: before and after coming to rest). Raises ValueError
    for a command that is not finite or a negative span, and OutOfModelError for a car that is
    unstable and spins ever faster.
    """
    if not (math.isfinite(actuation.steering) and math.isfinite(actuation.acceleration)):
        raise ValueError(f"a command must be finite: {actuation}")
    if not 0.0 <= span < math.inf:
        raise ValueError(f"a span must be finite and not negative: {span}")
    acceleration = actuation.acceleration
    command = min(max(actuation.steering, -parameters.steering_limit), parameters.steering_limit)
    final_speed = body.speed + acceleration * span
    if parameters.tyres == "brush":
        return _advance_on_brushes(body, command, acceleration, span, parameters, substeps=substeps)
    if final_speed >= 0.0:
        return _integrate(body, command, final_speed, span, parameters, substeps=substeps)
    rolling = -body.speed / acceleration
    stopped = _integrate(body, command, 0.0, rolling, parameters, substeps=substeps)
    return _integrate(stopped, command, 0.0, span - rolling, parameters, substeps=substeps)


def _advance_on_brushes(
    body: Body,
    command: float,
    acceleration: float,
    span: float,
    p: VehicleParameters,
    *,
    substeps: int | None,
) -> Body:
    """Advance on tyres that saturate."""
    if span <= 0.0:
        return body
    # A slide changes the speed by the turn of the body as well.
    gained = span * (acceleration + body.yaw_rate * body.lateral_speed)
    slowest = max(min(body.speed, body.speed + gained), WALKING_PACE)
    place, state = brush_motion.move(
        (body.east, body.north, body.yaw, body.distance),
        (body.speed, body.lateral_speed, body.yaw_rate, body.steering, body.steering_rate),
        command=command,
        acceleration=acceleration,
        span=span,
        parameters=p,
        fastest=_fastest_rate(slowest, lateral_coefficients(p), p),
        substeps=substeps,
    )
    return Body(place[0], place[1], place[2], *state, place[3])


def _lateral_rates(speed: float, tyres: Coefficients, p: VehicleParameters) -> _Lateral:
    """Coefficients (a, b, c, d, e, f) of v_y' = a v_y + b r + c delta, r' = d v_y + e r + f delta.

    Below WALKING_PACE the matrix stays as it is there and the steering's column is chosen so that
    the equilibrium is that of the present speed.
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


def fastest_rate(p: VehicleParameters) -> float:
    """Return the fastest rate of the car's tyres and steering (1/s), which is that at low speed.

    Of the tyres it is the larger damping of eqs. (1), (2), of the steering the faster pole of
    eq. (4).
    """
    return _fastest_rate(WALKING_PACE, lateral_coefficients(p), p)


def _fastest_rate(speed: float, tyres: Coefficients, p: VehicleParameters) -> float:
    damping = p.steering_damping
    overdamped = damping + math.sqrt(damping * damping - 1.0) if damping > 1.0 else 1.0
    return max(-min(tyres[0], tyres[4]) / speed, overdamped * p.steering_frequency)


def _substeps(slowest: float, span: float, tyres: Coefficients, p: VehicleParameters) -> int:
    """Count the sub-steps for a span in which the speed does not fall below `slowest`."""
    return math.ceil(span * _fastest_rate(max(slowest, WALKING_PACE), tyres, p) / STEP_PER_RATE)


def _integrate(
    body: Body,
    command: float,
    final_speed: float,
    span: float,
    p: VehicleParameters,
    *,
    substeps: int | None,
) -> Body:
    """Advance while the speed changes evenly from the body's to `final_speed`."""
    if span <= 0.0:
        return body
    tyres = lateral_coefficients(p)
    near_limit = steps_for_steering(span, command - body.steering, body.steering_rate, p)
    slowest = min(body.speed, final_speed)
    count = substeps or max(_substeps(slowest, span, tyres, p), near_limit)
    free = actuator(p)
    place = (body.east, body.north, body.yaw, body.distance)
    state = (body.lateral_speed, body.yaw_rate, body.steering, body.steering_rate)
    speed, change = body.speed, (final_speed - body.speed) / count
    before = middle = after = _lateral_rates(speed, tyres, p)
    for index in range(count):
        faster = body.speed + change * (index + 1)
        speeds = (speed, 0.5 * (speed + faster), faster)
        if change != 0.0:
            middle = _lateral_rates(speeds[1], tyres, p)
            after = _lateral_rates(faster, tyres, p)
        held = near_limit and is_at_rate_limit(command - state[2], state[3], p)
        place, state = _step(
            place, state, speeds, (before, middle, after), command=command, h=span / count,
            actuation=(0.0, 0.0) if held else free,
        )  # fmt: skip
        if abs(state[2]) > p.steering_limit or abs(state[3]) > p.steering_rate_limit:
            state = (state[0], state[1], *stopped_at_limits(state[2], state[3], p))
        speed, before = faster, after
    if not abs(state[0]) < FASTEST_SLIDE:
        raise OutOfModelError(f"the car spins: it is unstable at {final_speed:.1f} m/s")
    return Body(place[0], place[1], place[2], final_speed, *state, place[3])


def _step(
    place: Four,
    state: Four,
    speeds: tuple[float, float, float],
    rates: tuple[_Lateral, _Lateral, _Lateral],
    *,
    command: float,
    h: float,
    actuation: tuple[float, float],
) -> tuple[Four, Four]:
    """One Runge-Kutta step, written out because every run spends its time here.

    `place` is (east, north, yaw, distance), `state` is (lateral speed, yaw rate, steering,
    steering rate); speeds and rates are those at the start, the middle and the end of the step.
    The derivative of the four state variables at stage i is (ai, bi, wi, di).
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
    return moved(place, (v1, v2, v2, v4), (y1, y2, y3, y4), (r1, r2, r3, r4), h), (
        y1 + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        r1 + sixth * (b1 + 2.0 * (b2 + b3) + b4),
        s1 + sixth * (w1 + 2.0 * (w2 + w3) + w4),
        w1 + sixth * (d1 + 2.0 * (d2 + d3) + d4),
    )
