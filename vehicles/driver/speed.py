"""How fast to go: a given speed over time, or keeping the gap to what is ahead. SI units."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

GAP_STIFFNESS = 3.0
"""k_p, acceleration asked per metre of gap error (1/s²)."""

DAMPING = 4.0
"""k_v + k_l, acceleration asked per m/s of speed difference to predecessor and lead (1/s)."""

LEAD_SHARE = 0.5
"""Share of the damping that counts from the lead, k_l, at constant distance."""

STABLE_HEADWAY = 0.35
"""Headway (s) from which on the lead's speed is not needed, and is not used."""

CATCH_UP_DISTANCE = 5.0
"""A gap that is too large by more than this (m) does not make the vehicle hurry more."""


class SpeedProfile:
    """Speed (m/s) over time (s), piecewise linear, constant before the first and after the last.

    The predetermined profile of Section V-C.3, Fig. 11.
    """

    def __init__(self, times: Sequence[float], speeds: Sequence[float]) -> None:
        if len(times) != len(speeds) or not times:
            raise ValueError("a speed profile needs as many speeds as times, at least one")
        if not all(map(math.isfinite, (*times, *speeds))) or min(speeds) < 0.0:
            raise ValueError("times and speeds must be finite numbers, speeds not negative")
        if any(later <= earlier for earlier, later in pairwise(times)):
            raise ValueError("the times of a speed profile must increase")
        self._times = tuple(map(float, times))
        self._speeds = tuple(map(float, speeds))

    def at(self, seconds: float) -> tuple[float, float]:
        """Speed (m/s) and acceleration (m/s²); at a corner, the acceleration that follows it.

        Velocity and acceleration of Fig. 11, by linear interpolation.
        """
        times, speeds = self._times, self._speeds
        index = bisect_right(times, seconds) - 1
        if index < 0:
            return speeds[0], 0.0
        if index == len(times) - 1:
            return speeds[-1], 0.0
        slope = (speeds[index + 1] - speeds[index]) / (times[index + 1] - times[index])
        return speeds[index] + slope * (seconds - times[index]), slope


@dataclass(frozen=True, slots=True)
class GapPolicy:
    """The gap to keep (m): `standstill` (m) plus `headway` (s) times speed.

    Constant time headway policy; a headway of 0 keeps a constant distance. The paper is silent.
    """

    standstill: float
    headway: float = 0.0

    def __post_init__(self) -> None:
        _require_not_negative(self)

    def desired(self, speed: float) -> float:
        """Gap to keep (m) at `speed` (m/s), by the constant time headway policy."""
        return self.standstill + self.headway * speed


@dataclass(frozen=True, slots=True)
class GapLimits:
    """What gap keeping may ask of the drive (m/s², both positive); the paper is silent.

    2 m/s² is brisk driving; 6 m/s² is hard braking on a dry road with some grip in reserve, twice
    what a lead should use, so that followers can make good their delay.
    """

    acceleration: float = 2.0
    deceleration: float = 6.0

    def __post_init__(self) -> None:
        _require_not_negative(self)


def gap_acceleration(
    *,
    gap: float,
    own_speed: float,
    predecessor_speed: float,
    lead_speed: float,
    policy: GapPolicy,
    limits: GapLimits,
) -> float:
    """Decide the acceleration (m/s²) that keeps the gap, from what was heard of those ahead.

    a = k_p (gap - desired) + k_v (v_pred - v) + k_l (v_lead - v). At constant distance errors pass
    from one vehicle to the next as (k_v s + k_p) / (s² + (k_v + k_l) s + k_p), which nowhere
    exceeds 1 if (k_v + k_l)² - k_v² >= 2 k_p: here 12 >= 6, the margin being for the delay of a
    radio. Without the lead's speed (k_l = 0) it does somewhere (Swaroop and Hedrick, 1996).

    With a headway h the predecessor alone suffices, if k_p h² + 2 k_v h >= 2 (h >= 0.23 s here),
    and the lead's speed would do harm: in steady braking the i-th vehicle is i h a faster than the
    lead, so errors would grow with i. Its share therefore fades out towards STABLE_HEADWAY.

    `gap` (m) is that of now: extrapolate a heard position by its speed and age. A lead speed of
    NaN (nothing heard) counts as the predecessor's. Nothing is known of accelerations: while all
    brake at b, gaps are off by (1 - (k_v + k_l) h) b / k_p, at constant distance 1 m too short for
    b = 3 m/s², and stay so if the convoy stops. Speeds in m/s; the result is within `limits`.
    """
    if math.isnan(lead_speed):
        lead_speed = predecessor_speed
    share = LEAD_SHARE * max(0.0, 1.0 - policy.headway / STABLE_HEADWAY)
    ahead = predecessor_speed + share * (lead_speed - predecessor_speed)
    error = min(gap - policy.desired(own_speed), CATCH_UP_DISTANCE)
    wanted = GAP_STIFFNESS * error + DAMPING * (ahead - own_speed)
    return min(max(wanted, -limits.deceleration), limits.acceleration)


def _require_not_negative(values: GapPolicy | GapLimits) -> None:
    for field in fields(values):
        value = getattr(values, field.name)
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{field.name} must be a number of at least 0, not {value}")
