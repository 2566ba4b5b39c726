"""Covariance of a pose estimate together with the lasting errors of its receiver.

A Kalman filter of errors, each the true value minus the estimate, in the east-north plane
(R. E. Kalman, Journal of Basic Engineering 82, 1960). Errors of fixes that last cannot be averaged
out. Each is a state of the filter, per axis, as a first-order Gauss–Markov process (R. G. Brown,
P. Y. C. Hwang, "Introduction to Random Signals and Applied Kalman Filtering"). The unknown load of
the car is considered but not estimated (S. F. Schmidt, "Application of State-Space Methods to
Navigation Problems", 1966): in a long bend its error of the slip does not average out either.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.gnss_errors import StatedErrors
from vehicles.car.imu import UNKNOWN_LOAD
from vehicles.messages import FixState

FloatArray = NDArray[np.float64]

EAST: Final = 0
NORTH: Final = 1
HEADING: Final = 2
SPEED_BIAS: Final = 3
GYRO_BIAS: Final = 4
LOAD: Final = 5
FIRST_ERROR: Final = 6  # Index of the first lasting error; each has two states, east and north
MEASURED: Final = 5  # Number of measured states of a fix, which are the first ones

GATE: Final = 6.0  # Innovations beyond this number of standard deviations are outliers
LEAST_VARIANCE: Final = (
    1e-12  # Of a measurement, so that exact ones of exact states are no special case
)
IGNORED: Final = 1e12  # Variance of a measurement that is not used


class Densities(NamedTuple):
    """Random walks along and across the body (m²/s), and of its heading (rad²/s)."""

    along: float
    across: float
    heading: float


class Step(NamedTuple):
    """A step of dead reckoning: duration (s), displacement (m), initial yaw (rad), slip.

    `lever` (m) is the lateral displacement per yaw rate times duration, `load_effect` (m) that per
    relative error of the load.
    """

    span: float
    east: float
    north: float
    yaw: float
    lever: float
    load_effect: float

    def reversed(self) -> "Step":
        return Step(
            -self.span, -self.east, -self.north, self.yaw, self.lever, -self.load_effect
        )  # fmt: skip


class JointCovariance:
    """Joint covariance and estimated lasting errors.

    `values` are of the position (m), heading (rad), biases of speed (m/s) and gyroscope (rad/s),
    relative error of the load, and the lasting errors (m), which are estimated as `errors`.
    """

    def __init__(
        self, stated: StatedErrors, densities: Densities, deviations: Sequence[float]
    ) -> None:
        """`deviations` are those of biases of speed (m/s) and gyroscope (rad/s) at the start."""
        self._stated, self._densities = stated, densities
        size = FIRST_ERROR + 2 * len(stated.lasting)
        self.values: FloatArray = np.zeros((size, size))
        for column, deviation in enumerate((*deviations, UNKNOWN_LOAD), SPEED_BIAS):
            self.values[column, column] = deviation**2
        self.errors: FloatArray = np.zeros(size - FIRST_ERROR)
        self._transition: FloatArray = np.eye(size)
        self._noise: FloatArray = np.zeros((size, size))
        self._rows = {state: self._measurement(state, size) for state in stated.white}
        self._state: FixState | None = None
        self._fixed_at = 0

    def _measurement(self, state: FixState, size: int) -> FloatArray:
        """Matrix (5, size) from the states to the measured values of a fix."""
        rows: FloatArray = np.eye(MEASURED, size)
        for axis in (EAST, NORTH):
            rows[axis, self._active(axis, state)] = 1.0
        return rows

    def _active(self, axis: int, state: FixState) -> list[int]:
        """Columns of the states that add up to a measured coordinate."""
        errors = [
            FIRST_ERROR + 2 * index + axis
            for index, error in enumerate(self._stated.lasting)
            if state in error.states
        ]
        return [axis, *errors]

    def start(self, position: float, heading: float) -> None:
        """Start at a known pose with these variances (m², rad²), keeping those of the biases.

        The lasting errors of the receiver are unknown: they have their stationary variance.
        """
        p = self.values
        variances = p.diagonal().copy()
        variances[:SPEED_BIAS] = position, position, heading
        p[:] = np.diag(variances)
        self.errors[:] = 0.0
        self._state = None
        for index, error in enumerate(self._stated.lasting):
            self._restart(index, error.deviation)

    def start_at_fix(self, state: FixState, at: int, variance: float, heading: float) -> None:
        """Start at a fix at `at` (ns) with white noise of `variance` (m²); see `start`."""
        self.start(variance, heading)
        self._state, self._fixed_at = state, at
        p = self.values
        for axis in (EAST, NORTH):
            for column in self._active(axis, state)[1:]:
                p[axis, axis] += p[column, column]
                p[axis, column] = p[column, axis] = -p[column, column]

    def grow(self, step: Step) -> None:
        """Predict over a step of dead reckoning."""
        transition, q, span = self._transition_of(step), self._noise, step.span
        cos, sin = math.cos(step.yaw), math.sin(step.yaw)
        along, across, turning = [span * density for density in self._densities]
        common = span * self._stated.common_density
        east, north = step.east, step.north
        q[EAST, EAST] = along * cos * cos + across * sin * sin + common + turning * north**2 / 3.0
        q[NORTH, NORTH] = along * sin * sin + across * cos * cos + common + turning * east**2 / 3.0
        q[EAST, NORTH] = q[NORTH, EAST] = (
            along - across
        ) * cos * sin - turning * east * north / 3.0
        q[EAST, HEADING] = q[HEADING, EAST] = -0.5 * turning * north
        q[NORTH, HEADING] = q[HEADING, NORTH] = 0.5 * turning * east
        q[HEADING, HEADING] = turning
        for column, error in enumerate(self._stated.lasting):
            first = FIRST_ERROR + 2 * column
            q[first, first] = q[first + 1, first + 1] = error.growth(span)
        if self._stated.lasting:
            self.errors *= transition.diagonal()[FIRST_ERROR:]
        self.values = transition @ self.values @ transition.T + q

    def _transition_of(self, step: Step) -> FloatArray:
        """Matrix by which errors change over a step; valid until the next call."""
        f, span, cos, sin = self._transition, step.span, math.cos(step.yaw), math.sin(step.yaw)
        half, lever = 0.5 * span, step.lever
        f[EAST, HEADING], f[NORTH, HEADING] = -step.north, step.east
        f[EAST, SPEED_BIAS], f[NORTH, SPEED_BIAS] = -cos * span, -sin * span
        f[EAST, GYRO_BIAS] = half * step.north + sin * lever
        f[NORTH, GYRO_BIAS] = -half * step.east - cos * lever
        f[EAST, LOAD], f[NORTH, LOAD] = -sin * step.load_effect, cos * step.load_effect
        f[HEADING, GYRO_BIAS] = -span
        for column, error in enumerate(self._stated.lasting):
            first = FIRST_ERROR + 2 * column
            f[first, first] = f[first + 1, first + 1] = error.kept(span)
        return f

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

    def white_variance(self, state: FixState, accuracy: float) -> float:
        """Variance (m²) of the white noise of a fix with a stated `accuracy` (m, per axis)."""
        lasting = [one.deviation**2 for one in self._stated.lasting if state in one.states]
        rest = accuracy**2 - sum(lasting) - self._stated.common_variance
        return max(rest, self._stated.white[state])

    def correct(
        self,
        state: FixState,
        off: FloatArray,
        noise: Sequence[float],
        free: tuple[float, float],
        since: Step | None = None,
    ) -> FloatArray | None:
        """Correct by a fix that is `off` the estimate in the first five states.

        `noise` has the variances of its white noise. The fix may be off by `free` (m, rad) beyond
        the gate; otherwise it is an outlier, and None is returned. `since` is the movement since a
        fix that is late. Returns the corrections of the first five states.
        """
        rows = self._rows[state]
        off = off - rows[:, FIRST_ERROR:] @ self.errors
        if since is not None:
            rows = rows @ self._transition_of(since.reversed())
        p = self.values
        gains = rows @ p
        spread = gains @ rows.T
        spread.flat[:: MEASURED + 1] += np.maximum(noise, LEAST_VARIANCE)
        reach = free[0] + GATE * math.sqrt(spread[EAST, EAST] + spread[NORTH, NORTH])
        turn = free[1] + GATE * math.sqrt(spread[HEADING, HEADING])
        if math.hypot(off[EAST], off[NORTH]) > reach or abs(off[HEADING]) > turn:
            return None
        for column in (SPEED_BIAS, GYRO_BIAS):
            if off[column] ** 2 > GATE**2 * spread[column, column]:
                spread[column, column] = IGNORED
        weights = np.linalg.solve(spread, gains)
        change: FloatArray = off @ weights
        load = p[LOAD, LOAD]
        p -= gains.T @ weights
        p[LOAD, LOAD] = load
        self.values = 0.5 * (p + p.T)
        self.errors += change[FIRST_ERROR:]
        return change[:MEASURED]

    def deviation(self, direction: float) -> float:
        """Standard deviation (m) in a direction (rad), with errors shared by all receivers."""
        p, cos, sin = self.values, math.cos(direction), math.sin(direction)
        square = cos * cos * p[EAST, EAST] + sin * sin * p[NORTH, NORTH]
        square += 2.0 * cos * sin * p[EAST, NORTH] + self._stated.common_variance
        return math.sqrt(max(square, 0.0))
