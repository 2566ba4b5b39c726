"""Integration shared by both tyre models: position, steering limits, and step length.

World frame: east-north, yaw counter-clockwise from east. SI units.
"""

import math
from typing import Final

from vehicles.car.parameters import VehicleParameters

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
