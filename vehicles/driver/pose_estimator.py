"""Pose estimate of the own car: dead reckoning, corrected by its own fixes.

A complementary filter with constant gains. Between fixes the pose moves on an arc with the measured
speed and yaw rate and, sideways, with the lateral speed that steady cornering has at that speed
(lateral speed itself is not measured; paper, Section III-E). Each fix corrects the pose by
a constant share of the difference.
"""

import math
from dataclasses import dataclass

from vehicles.car.gnss import Fix
from vehicles.car.parameters import VehicleParameters
from vehicles.geometry.geodesy import wrap_angle
from vehicles.schedule import SECOND

POSITION_GAIN = 0.25
"""Share of the position's innovation that is taken over.

White noise of a fix is passed on times sqrt(K / (2 - K)) = 0.38: 2 cm become 8 mm. An unmodelled
drift of d per fix lags by about d / K: while the slip builds up in an emergency lane change at
30 m/s the estimate is 15 mm off sideways, for a third of a second. Over such a swerve the two
together are least, 11 mm rms, for gains from 0.15 to 0.25; the larger one is quicker to recover.
"""

HEADING_GAIN = 0.1
"""Share of the heading's innovation that is taken over.

Noise is passed on times 0.23: 0.1 deg become 0.4 mrad. It may be low because the yaw rate, which
carries the heading between fixes, is measured: its noise moves the heading by 0.06 mrad per fix.
"""

JUMP_DISTANCE = 3.0
"""A fix further (m) than this from dead reckoning is an outlier, at an age of 0."""

JUMP_GROWTH = 3.0
"""By how much (m/s) that distance grows with the time since the last fix that was used."""

JUMP_HEADING = 0.5
"""A fix whose heading differs by more than this (rad) is an outlier too."""

JUMPS_BELIEVED = 3
"""After so many outliers in a row that agree with one another the filter restarts there."""


@dataclass(slots=True)
class Pose:
    """Estimated position (m), yaw (rad, within (-pi, pi]), speed (m/s) and yaw rate (rad/s).

    What the vehicle block of Fig. 1 puts out, in the world frame.
    """

    east: float
    north: float
    yaw: float
    speed: float
    yaw_rate: float


@dataclass(slots=True)
class _Track:
    """A pose, the instant (ns) it holds for and how many fixes it rests on."""

    pose: Pose
    at: int
    fixes: int


class PoseEstimator:
    """Estimates the pose of the vehicle that has `parameters` from its own fixes.

    A complementary filter, in place of the integrated GPS and IMU of Section V-D.
    """

    def __init__(self, parameters: VehicleParameters) -> None:
        self._parameters = parameters
        self._track: _Track | None = None
        self._rival: _Track | None = None

    def assume(self, parameters: VehicleParameters) -> None:
        """Take other parameters of the car for its slip, by eqs. (1), (2), from now on."""
        self._parameters = parameters

    def correct(self, fix: Fix) -> None:
        """Take in a fix of the vehicle itself; they come in the order of measurement.

        The first one is taken as it is, and the gains start from 1/n for the n-th, which is the
        mean of the first few. Fixes that are not finite or not newer than the last are ignored. An
        outlier (see JUMP_DISTANCE) is ignored too, unless it is the third in a row of outliers
        that dead reckoning joins to one another: then the filter restarts there.
        """
        if not all(map(math.isfinite, (fix.east, fix.north, fix.yaw, fix.speed, fix.yaw_rate))):
            return
        if self._track is None:
            self._track = _started(fix)
        elif fix.measured_at > self._track.at:
            self._take(self._track, fix)

    def _take(self, track: _Track, fix: Fix) -> None:
        corrected = self._corrected(track, fix)
        if corrected is not None:
            self._track, self._rival = corrected, None
            return
        rival = self._corrected(self._rival, fix) if self._rival else None
        self._rival = rival or _started(fix)
        if self._rival.fixes >= JUMPS_BELIEVED:
            self._track, self._rival = self._rival, None

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns) by dead reckoning; ValueError before the first fix.

        The slip is that of steady cornering by eqs. (1), (2).
        """
        if self._track is None:
            raise ValueError("no pose before the first fix")
        pose = self._track.pose
        return self._moved(pose, pose.speed, pose.yaw_rate, (now - self._track.at) / SECOND)

    def _corrected(self, track: _Track, fix: Fix) -> _Track | None:
        """Take `fix` into a track; None if the fix is an outlier to it."""
        span = (fix.measured_at - track.at) / SECOND
        if span <= 0.0:
            return None
        # Over a span whose both ends were measured the means are exact to second order.
        speed = 0.5 * (track.pose.speed + fix.speed)
        yaw_rate = 0.5 * (track.pose.yaw_rate + fix.yaw_rate)
        pose = self._moved(track.pose, speed, yaw_rate, span)
        ahead, aside = fix.east - pose.east, fix.north - pose.north
        turned = wrap_angle(fix.yaw - pose.yaw)
        reach = JUMP_DISTANCE + JUMP_GROWTH * span
        if math.hypot(ahead, aside) > reach or abs(turned) > JUMP_HEADING:
            return None
        fixes = track.fixes + 1
        gain = max(POSITION_GAIN, 1.0 / fixes)
        corrected = Pose(
            east=pose.east + gain * ahead,
            north=pose.north + gain * aside,
            yaw=wrap_angle(pose.yaw + max(HEADING_GAIN, 1.0 / fixes) * turned),
            speed=fix.speed,
            yaw_rate=fix.yaw_rate,
        )
        return _Track(corrected, fix.measured_at, fixes)

    def _moved(self, pose: Pose, speed: float, yaw_rate: float, span: float) -> Pose:
        """Dead reckoning over `span` (s): exact for constant speed, yaw rate and slip."""
        lateral_speed = self._parameters.steady_slip_per_curvature(speed) * yaw_rate
        half = 0.5 * yaw_rate * span
        # A body that turns evenly covers its chord, which points half the turn ahead.
        chord = span * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        cos, sin = math.cos(pose.yaw + half), math.sin(pose.yaw + half)
        return Pose(
            east=pose.east + chord * (speed * cos - lateral_speed * sin),
            north=pose.north + chord * (speed * sin + lateral_speed * cos),
            yaw=wrap_angle(pose.yaw + yaw_rate * span),
            speed=pose.speed,
            yaw_rate=pose.yaw_rate,
        )


def _started(fix: Fix) -> _Track:
    return _Track(Pose(fix.east, fix.north, fix.yaw, fix.speed, fix.yaw_rate), fix.measured_at, 1)
