"""How fast a vehicle wants to go: a common profile, or keeping its gap to what it hears."""

from dataclasses import dataclass
from math import nan
from typing import Protocol

from vehicles.driver.pose_estimator import Pose
from vehicles.driver.speed import GapLimits, GapPolicy, SpeedProfile, gap_acceleration
from vehicles.schedule import SECOND

PROFILE_CORRECTION = 0.5
"""Share of the speed error taken back each second when a profile is followed (1/s)."""


@dataclass(slots=True)
class Convoy:
    """What a follower knows of the vehicles ahead, NaN where it heard nothing.

    For keeping gaps, on which the paper is silent.

    The gap to the predecessor (m) is along its trace, extrapolated to now; speeds (m/s) are
    those heard last.
    """

    gap: float = nan
    predecessor_speed: float = nan
    lead_speed: float = nan


@dataclass(slots=True)
class Drive:
    """Acceleration asked of the drive (m/s²), dv_x/dt of Section IV-A, and speed aimed at (m/s)."""

    acceleration: float
    target_speed: float


class SpeedLaw(Protocol):
    """Decides the longitudinal command at a control instant: that of Section V-C.3 or another."""

    def drive(self, now: int, pose: Pose, convoy: Convoy) -> Drive:
        """Command at `now` (ns) for a vehicle at `pose` in `convoy`, such as Section V-C.3's."""
        ...


class ProfileSpeed:
    """Every vehicle follows the same speed over time (paper, Section V-C)."""

    def __init__(self, profile: SpeedProfile, start_at: int, period: float) -> None:
        """`period` (s) is the control period over which a command is held."""
        self._profile = profile
        self._start_at = start_at
        self._period = period

    def drive(self, now: int, pose: Pose, convoy: Convoy) -> Drive:  # noqa: ARG002
        """Mean acceleration of the profile over the coming period, plus a mild correction.

        The profile is that of Section V-C.3, the correction our own.
        """
        seconds = (now - self._start_at) / SECOND
        speed, _ = self._profile.at(seconds)
        next_speed, _ = self._profile.at(seconds + self._period)
        wanted = (next_speed - speed) / self._period
        return Drive(wanted + PROFILE_CORRECTION * (speed - pose.speed), next_speed)


class GapKeeping:
    """Keeps a constant distance or time gap to what was heard of predecessor and lead.

    Beyond the paper; after Swaroop and Hedrick, 1996 (see `gap_acceleration`).
    """

    def __init__(self, policy: GapPolicy, limits: GapLimits) -> None:
        """`policy` sets the gap, `limits` the accelerations."""
        self._policy = policy
        self._limits = limits

    def drive(self, now: int, pose: Pose, convoy: Convoy) -> Drive:  # noqa: ARG002
        """Coasts at constant speed until the predecessor has been heard; beyond the paper."""
        if convoy.gap != convoy.gap:
            return Drive(0.0, pose.speed)
        wanted = gap_acceleration(
            gap=convoy.gap,
            own_speed=pose.speed,
            predecessor_speed=convoy.predecessor_speed,
            lead_speed=convoy.lead_speed,
            policy=self._policy,
            limits=self._limits,
        )
        return Drive(wanted, convoy.predecessor_speed)
