"""The own pose of a car: interface of its estimators, and the exact state."""

from dataclasses import dataclass
from typing import Protocol

from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.geometry.geodesy import wrap_angle


@dataclass(slots=True)
class Pose:
    """Position (m, world frame), yaw (rad, within (-pi, pi]), speed (m/s), yaw rate (rad/s)."""

    east: float
    north: float
    yaw: float
    speed: float
    yaw_rate: float


class OwnState(Protocol):
    """Estimates the own pose: the vehicle block of Fig. 1, with the integration of V-D."""

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        """Process the measurements at `now` (ns): an own fix, a reading, both or none."""
        ...

    def at(self, now: int) -> Pose:
        """Pose at `now` (ns), not before the last update; ValueError before the first."""
        ...

    @property
    def lateral_deviation(self) -> float:
        """Standard deviation (m) of the position across the body; NaN if it is unknown."""
        ...


class ExactState:
    """The true state of the car, from an exact sensor (the simulations of Section V-C)."""

    def __init__(self) -> None:
        self._pose: Pose | None = None

    def update(self, now: int, fix: Fix | None, motion: Motion | Body | None) -> None:
        if isinstance(motion, Body):
            yaw = wrap_angle(motion.yaw)
            self._pose = Pose(motion.east, motion.north, yaw, motion.speed, motion.yaw_rate)

    @property
    def lateral_deviation(self) -> float:
        return 0.0

    def at(self, now: int) -> Pose:
        if self._pose is None:
            raise ValueError("no pose before the first reading")
        return self._pose


# ---- Covariance of a pose estimate: two small Kalman filters with explicit formulas
#
# In the body frame, errors along and across are estimated separately. Their correlation, which
# arises if the body turns by half a radian while an error lasts, is neglected. An error is true
# value minus estimate. A gain is the covariance of the measured state with the one to correct,
# divided by the variances of measured state plus measurement.


EXACT = 1.0, 0.0, 0.0  # Gains for a noise-free measurement of an exactly known state


@dataclass(slots=True)
class AlongCovariance:
    """Covariance of the position along the body (a, m) and the speed bias (s, m/s); a' = -s.

    Source: Kalman, Journal of Basic Engineering 82, 1960.
    """

    aa: float
    ss: float
    sa: float = 0.0

    def grow(self, span: float, density: float) -> None:
        """Predict over `span` (s), with a random walk of `density` (m²/s)."""
        self.aa += span * (density + span * self.ss - 2.0 * self.sa)
        self.sa -= span * self.ss

    def by_position(self, innovation: float, variance: float) -> tuple[float, float]:
        """Correct by a measured position; returns the corrections of position and bias."""
        total = self.aa + variance
        gain, bias_gain = (self.aa / total, self.sa / total) if total > 0.0 else EXACT[:2]
        ss = self.ss - bias_gain * self.sa
        self.ss = 0.0 if ss < 0.0 else ss
        self.sa *= 1.0 - gain
        self.aa *= 1.0 - gain
        return gain * innovation, bias_gain * innovation

    def by_bias(self, innovation: float, variance: float) -> tuple[float, float]:
        """Correct by a measured bias; returns the corrections of position and bias."""
        total = self.ss + variance
        gain, place_gain = (self.ss / total, self.sa / total) if total > 0.0 else EXACT[:2]
        aa = self.aa - place_gain * self.sa
        self.aa = 0.0 if aa < 0.0 else aa
        self.sa *= 1.0 - gain
        self.ss *= 1.0 - gain
        return place_gain * innovation, gain * innovation


@dataclass(slots=True)
class AcrossCovariance:
    """Covariance of position across the body (c, m), heading (h, rad), gyroscope bias (g, rad/s).

    c' = v h + l h', h' = -g with the speed v and the steady slip l per yaw rate.
    Source: Kalman, Journal of Basic Engineering 82, 1960.
    """

    cc: float
    hh: float
    gg: float
    hc: float = 0.0
    gc: float = 0.0
    gh: float = 0.0

    def grow(
        self, span: float, distance: float, slip: float, across: float, heading: float
    ) -> None:
        """Predict over `span` (s) and `distance` (m), with `slip` l (m).

        The random walks have the densities `across` (m²/s) and `heading` (rad²/s).
        """
        across, heading = across * span, heading * span
        g, gh = -span * (0.5 * distance + slip), self.gh
        hc = self.hc + distance * self.hh + g * gh
        gc = self.gc + distance * gh + g * self.gg
        self.cc += (
            distance * (self.hc + hc) + g * (self.gc + gc) + across + distance**2 * heading / 3.0
        )
        self.hc = hc - span * gc + 0.5 * distance * heading
        self.gc = gc
        self.hh += span * (span * self.gg - 2.0 * gh) + heading
        self.gh = gh - span * self.gg

    def by_position(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured position; returns the corrections of position, heading, bias."""
        total = self.cc + variance
        c, h, g = (self.cc / total, self.hc / total, self.gc / total) if total > 0.0 else EXACT
        hh = self.hh - h * self.hc
        self.hh = 0.0 if hh < 0.0 else hh
        self.gh -= h * self.gc
        gg = self.gg - g * self.gc
        self.gg = 0.0 if gg < 0.0 else gg
        self.hc *= 1.0 - c
        self.gc *= 1.0 - c
        self.cc *= 1.0 - c
        return c * innovation, h * innovation, g * innovation

    def by_heading(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured heading; returns as `by_position`."""
        total = self.hh + variance
        h, c, g = (self.hh / total, self.hc / total, self.gh / total) if total > 0.0 else EXACT
        cc = self.cc - c * self.hc
        self.cc = 0.0 if cc < 0.0 else cc
        self.gc -= c * self.gh
        gg = self.gg - g * self.gh
        self.gg = 0.0 if gg < 0.0 else gg
        self.hc *= 1.0 - h
        self.gh *= 1.0 - h
        self.hh *= 1.0 - h
        return c * innovation, h * innovation, g * innovation

    def by_bias(self, innovation: float, variance: float) -> tuple[float, float, float]:
        """Correct by a measured bias of the gyroscope; returns as `by_position`."""
        total = self.gg + variance
        g, c, h = (self.gg / total, self.gc / total, self.gh / total) if total > 0.0 else EXACT
        cc = self.cc - c * self.gc
        self.cc = 0.0 if cc < 0.0 else cc
        self.hc -= c * self.gh
        hh = self.hh - h * self.gh
        self.hh = 0.0 if hh < 0.0 else hh
        self.gc *= 1.0 - g
        self.gh *= 1.0 - g
        self.gg *= 1.0 - g
        return c * innovation, h * innovation, g * innovation
