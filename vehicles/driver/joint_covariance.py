"""Covariance of a pose estimate together with the lasting errors of its receiver.

Errors that last from fix to fix cannot be averaged out. Each is a state of the filter, per axis, as
a first-order Gauss–Markov process (R. G. Brown, P. Y. C. Hwang, "Introduction to Random Signals and
Applied Kalman Filtering"). The unknown load of the car is considered but not estimated
(S. F. Schmidt, "Application of State-Space Methods to Navigation Problems", 1966): in a long bend
its error of the slip does not average out either.

All errors are true value minus estimate, in the east-north plane.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vehicles.car.gnss_errors import StatedErrors
from vehicles.car.imu import UNKNOWN_LOAD
from vehicles.driver.own_state import AcrossCovariance, AlongCovariance
from vehicles.messages import FixState

EAST: Final = 0
NORTH: Final = 1
HEADING: Final = 2
SPEED_BIAS: Final = 3
GYRO_BIAS: Final = 4
LOAD: Final = 5
FIRST_ERROR: Final = 6  # Index of the first lasting error; each has two states, east and north


class Step:
    """A step of dead reckoning: displacement (m), span (s), yaw (rad), sensitivities, noise.

    `lever` (m) is the lateral speed per yaw rate, `load_effect` (m) the lateral displacement per
    relative error of the load. Densities of random walks are `along` and `across` the body (m²/s)
    and `turning` (rad²/s).
    """

    def __init__(  # noqa: PLR0917 - its fields
        self,
        span: float,
        east: float,
        north: float,
        yaw: float,
        lever: float,
        load_effect: float,
        along: float,
        across: float,
        turning: float,
    ) -> None:
        self.span = span
        self.east, self.north = east, north
        self.cos, self.sin = math.cos(yaw), math.sin(yaw)
        self.lever = lever
        self.load_effect = load_effect
        self.along, self.across, self.turning = along, across, turning


class JointCovariance:
    """Joint covariance, estimated lasting errors, and the corrections that a fix implies.

    `values` are position (m), heading (rad), biases of speed (m/s) and gyroscope (rad/s), relative
    error of the load, and the lasting errors (m). Corrections add up in `change` until taken.
    """

    def __init__(self, stated: StatedErrors) -> None:
        """Start with unknown lasting errors, at their stationary variance."""
        size = FIRST_ERROR + 2 * len(stated.lasting)
        self._stated = stated
        self.values: NDArray[np.float64] = np.zeros((size, size))
        self.values[LOAD, LOAD] = UNKNOWN_LOAD**2
        self.change: NDArray[np.float64] = np.zeros(size)
        self.errors = [0.0] * (size - FIRST_ERROR)
        for index, error in enumerate(stated.lasting):
            self._restart(index, error.deviation)
        self._state: FixState | None = None
        self._fixed_at = 0
        self._span = -1.0
        self._kept = self._growth = self.change

    @classmethod
    def joined(
        cls, stated: StatedErrors, along: AlongCovariance, across: AcrossCovariance, yaw: float
    ) -> "JointCovariance":
        """Continue the covariances of an estimate whose fixes had white noise only."""
        joint, p = cls(stated), np.zeros((5, 5))
        p[:2, :2] = np.diag((along.aa, across.cc))
        p[0, 3], p[1, 2], p[1, 4] = along.sa, across.hc, across.gc
        p[3, 3] = along.ss
        p[2, 2], p[4, 4], p[2, 4] = across.hh, across.gg, across.gh
        p = np.triu(p) + np.triu(p, 1).T
        cos, sin = math.cos(yaw), math.sin(yaw)
        east, north = cos * p[0] - sin * p[1], sin * p[0] + cos * p[1]
        p[0], p[1] = east, north
        east, north = cos * p[:, 0] - sin * p[:, 1], sin * p[:, 0] + cos * p[:, 1]
        p[:, 0], p[:, 1] = east, north
        joint.values[:5, :5] = p
        return joint

    @classmethod
    def at_fix(
        cls, stated: StatedErrors, state: FixState, at: int, deviations: Sequence[float]
    ) -> "JointCovariance":
        """Start at a fix at `at` (ns); the position has the errors of the fix.

        `deviations` are of heading (rad), speed bias (m/s) and gyroscope bias (rad/s).
        """
        joint = cls(stated)
        joint._state, joint._fixed_at = state, at
        p = joint.values
        for index, deviation in enumerate(deviations):
            p[HEADING + index, HEADING + index] = deviation**2
        for axis in (EAST, NORTH):
            p[axis, axis] = stated.white[state]
            for column in joint._active(axis, state)[1:]:
                p[axis, axis] += p[column, column]
                p[axis, column] = p[column, axis] = -p[column, column]
        return joint

    def copy(self) -> "JointCovariance":
        other = JointCovariance(self._stated)
        other.values, other.errors = self.values.copy(), list(self.errors)
        other._state, other._fixed_at = self._state, self._fixed_at
        return other

    def grow(self, step: Step) -> None:
        p, span = self.values, step.span
        cos, sin, lever = step.cos, step.sin, -step.lever * span
        half = 0.5 * span
        rows = (
            (-step.north, -cos * span, half * step.north - sin * lever, -sin * step.load_effect),
            (step.east, -sin * span, -half * step.east + cos * lever, cos * step.load_effect),
        )
        for view in (p, p.T):
            for axis, (heading, speed, gyro, load) in enumerate(rows):
                view[axis] += (
                    heading * view[HEADING]
                    + speed * view[SPEED_BIAS]
                    + gyro * view[GYRO_BIAS]
                    + load * view[LOAD]
                )
            view[HEADING] -= span * view[GYRO_BIAS]
        self._add_noise(step)
        self._age(span)

    def _add_noise(self, step: Step) -> None:
        p, span, cos, sin = self.values, step.span, step.cos, step.sin
        along, across, turning = step.along * span, step.across * span, step.turning * span
        common = self._stated.common_density * span
        east, north = step.east, step.north
        p[EAST, EAST] += along * cos * cos + across * sin * sin + common + turning * north**2 / 3.0
        p[NORTH, NORTH] += along * sin * sin + across * cos * cos + common + turning * east**2 / 3.0
        both = (along - across) * cos * sin - turning * east * north / 3.0
        p[EAST, NORTH] += both
        p[NORTH, EAST] += both
        for axis, displacement in ((EAST, -north), (NORTH, east)):
            p[axis, HEADING] += 0.5 * turning * displacement
            p[HEADING, axis] += 0.5 * turning * displacement
        p[HEADING, HEADING] += turning

    def _age(self, span: float) -> None:
        """Let the lasting errors change over `span` (s), exactly."""
        lasting = self._stated.lasting
        if not lasting:
            return
        if span != self._span:
            kept = [1.0] * FIRST_ERROR
            growth = [0.0] * FIRST_ERROR
            for error in lasting:
                kept += [error.kept(span)] * 2
                growth += [error.growth(span)] * 2
            self._span, self._kept, self._growth = span, np.array(kept), np.array(growth)
        self.values *= self._kept
        self.values *= self._kept[:, None]
        self.values.flat[:: len(self._kept) + 1] += self._growth
        kept_list = self._kept[FIRST_ERROR:].tolist()
        self.errors = [k * error for k, error in zip(kept_list, self.errors, strict=True)]

    def enter(self, state: FixState, at: int) -> None:
        """Restart the errors that a fix in this state at `at` (ns) restarts."""
        entered = state != self._state or at - self._fixed_at > 1.5 * self._stated.period
        for index, error in enumerate(self._stated.lasting):
            if entered and state in error.states and error.entry_deviation is not None:
                self._restart(index, error.entry_deviation)
        self._state, self._fixed_at = state, at

    def _restart(self, index: int, deviation: float) -> None:
        """Make a lasting error independent of all others, with the given deviation (m)."""
        for column in (FIRST_ERROR + 2 * index, FIRST_ERROR + 2 * index + 1):
            self.values[column] = 0.0
            self.values[:, column] = 0.0
            self.values[column, column] = deviation**2
            self.errors[column - FIRST_ERROR] = 0.0

    def _active(self, axis: int, state: FixState) -> list[int]:
        """Columns of the states that add up to a measured coordinate."""
        errors = [
            FIRST_ERROR + 2 * index + axis
            for index, error in enumerate(self._stated.lasting)
            if state in error.states
        ]
        return [axis, *errors]

    def position_variance(self, state: FixState) -> float:
        """Variance (m²) of the distance of the next fix from the estimate, both axes."""
        total = 2.0 * self._stated.white[state]
        for axis in (EAST, NORTH):
            columns = self._active(axis, state)
            total += float(self.values[np.ix_(columns, columns)].sum())
        return total

    def variance(self, column: int) -> float:
        return float(self.values[column, column])

    def without_errors(self, east: float, north: float, state: FixState) -> tuple[float, float]:
        """Subtract the estimated lasting errors from a difference of positions (m)."""
        for column in self._active(EAST, state)[1:]:
            east -= self.errors[column - FIRST_ERROR]
            north -= self.errors[column - FIRST_ERROR + 1]
        return east, north

    def by_position(self, east: float, north: float, state: FixState) -> None:
        """Correct by a measured position, relative to the estimated one (m)."""
        both = self.without_errors(east, north, state)
        for axis, innovation in zip((EAST, NORTH), both, strict=True):
            self._correct(self._active(axis, state), innovation, self._stated.white[state])

    def by_state(
        self, column: int, innovation: float, variance: float, gate: float = math.inf
    ) -> None:
        """Correct by a measured heading or bias, relative to the estimated one.

        Innovations beyond `gate` standard deviations are ignored.
        """
        left = innovation - float(self.change[column])
        if left * left <= gate * gate * (variance + self.variance(column)):
            self._correct([column], innovation, variance)

    def adopt_biases(self, other: "JointCovariance") -> None:
        """Take over the variances of the sensor biases of another estimate."""
        for column in (SPEED_BIAS, GYRO_BIAS):
            self.values[column, column] = other.values[column, column]

    def _correct(self, columns: list[int], innovation: float, variance: float) -> None:
        p = self.values
        gain = p[columns[0]].copy()
        for column in columns[1:]:
            gain += p[column]
        total = variance
        for column in columns:
            total += float(gain[column])
            innovation -= float(self.change[column])
        if total <= 0.0:
            return
        load = float(p[LOAD, LOAD])
        p -= gain * (gain[:, None] / total)
        p[LOAD, LOAD] = load
        gain[LOAD] = 0.0
        self.change += gain * (innovation / total)

    def taken(self) -> list[float]:
        """Corrections of position, heading and biases; those of the errors are applied."""
        change: list[float] = self.change.tolist()
        self.change[:] = 0.0
        self.errors = [a + b for a, b in zip(self.errors, change[FIRST_ERROR:], strict=True)]
        return change[:FIRST_ERROR]

    def deviations(self, yaw: float) -> tuple[float, float, float]:
        """Standard deviations along and across a direction (m), and of the heading (rad).

        Errors shared by all receivers are included.
        """
        p, cos, sin = self.values, math.cos(yaw), math.sin(yaw)
        common = self._stated.common_variance
        east, north, both = float(p[0, 0]), float(p[1, 1]), float(2.0 * cos * sin * p[0, 1])
        along = cos * cos * east + sin * sin * north + both + common
        across = sin * sin * east + cos * cos * north - both + common
        return (
            math.sqrt(max(along, 0.0)),
            math.sqrt(max(across, 0.0)),
            math.sqrt(max(float(p[HEADING, HEADING]), 0.0)),
        )
