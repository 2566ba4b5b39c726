"""Motion of the car on saturating tyres: a car that can slide, spin and brake up to friction.

The single-track model of Section II with its small angles, lateral forces of the brush model (see
`tyres`), and the speed along the body as a state, so that a slide costs speed. With slip angles
s_f = (v_y + a r)/v - δ, s_r = (v_y - b r)/v and the acceleration a_x of drive or brakes,

    v'   = a_x + r v_y - F_f δ / m          F_f, F_r: brush forces at s_f and s_r
    v_y' = (F_f + F_r) / m - r v
    r'   = (a F_f - b F_r) / I,

so that kinetic energy changes at the rate m a_x v + v (F_f s_f + F_r s_r): without drive it never
grows. Cornering costs speed by the tyres' slip, 0.01 m/s² at 2 m/s² of lateral acceleration.

The commanded acceleration acts without delay, up to friction, as in the paper. The car never rolls
backwards: if it spins beyond a right angle to its path, it slides sideways until it stops.

Below WALKING_PACE the slip speeds are divided by WALKING_PACE. For v -> 0 this is the kinematic
single-track model; it is continuous in v, and braking is still limited by friction. The steering
for a curvature is then L + K_sg v WALKING_PACE, within 0.1 % of eq. (6).

Classical Runge-Kutta, sub-steps as in `dynamics`. Tolerance over a span of 20 ms against the exact
solution, in full slides and under braking: 0.1 mm in position, 0.01 m/s, 0.01 rad/s. The largest
errors occur at the onset of sliding and at the stop; elsewhere they are a tenth of that.
"""

import math

from vehicles.car.integration import STEP_PER_RATE, Steering, Vector4, integrate_position
from vehicles.car.parameters import VehicleParameters
from vehicles.car.tyres import GRAVITY, WALKING_PACE, lateral_share

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
            position, state = _step(position, state, command, drive, h, tyres, actuation)
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


def _step(  # noqa: PLR0917 - as above
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
