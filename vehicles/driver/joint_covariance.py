"""Covariance of a pose estimate together with the lasting errors of its receiver.

A Kalman filter of errors, each the true value minus the estimate, in the east-north plane
(R. E. Kalman, Journal of Basic Engineering 82, 1960). Errors of fixes that last cannot be averaged
out. Each is a state of the filter, per axis, as a first-order Gauss–Markov process (R. G. Brown,
P. Y. C. Hwang, "Introduction to Random Signals and Applied Kalman Filtering"). The unknown load of
the car is considered but not estimated (S. F. Schmidt, "Application of State-Space Methods to
Navigation Problems", 1966): in a long bend its error of the slip does not average out either.

No result depends on a linear-algebra library, so runs give the same bytes on other processors.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vehicles.car.gnss import Fix
from vehicles.car.gnss_settings import StatedErrors
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
STEP: Final = 0.1  # Time (s) of dead reckoning after which the covariance is predicted


class JointCovariance:
    """Joint covariance `values` and estimated lasting errors.

    The states are position (m), heading (rad), biases of speed (m/s) and gyroscope (rad/s), the
    relative error of the load, and the lasting errors (m).
    """

    def __init__(
        self, stated: StatedErrors, densities: Sequence[float], deviations: Sequence[float]
    ) -> None:
        """`deviations` are those of biases of speed (m/s) and gyroscope (rad/s) at the start.

        `densities` are those of random walks along and across the body (m²/s), and of its heading
        (rad²/s).
        """
        self._stated, self._densities = stated, densities
        size = FIRST_ERROR + 2 * len(stated.lasting)
        self.values: FloatArray = np.zeros((size, size))
        for column, deviation in enumerate((*deviations, UNKNOWN_LOAD), SPEED_BIAS):
            self.values[column, column] = deviation**2
        self._errors: FloatArray = np.zeros(size)  # estimated; only lasting ones are kept
        self._transition: FloatArray = np.eye(size)
        self._noise: FloatArray = np.zeros((size, size))
        self._columns = {
            state: [self._active(measured, state) for measured in range(MEASURED)]
            for state in stated.white
        }
        self._since, self._yaw = np.zeros(4), 0.0
        self._state: FixState | None = None
        self._fixed_at = 0

    def _active(self, axis: int, state: FixState) -> list[int]:
        """Columns of the states that add up to a measured value, a coordinate or another."""
        columns = enumerate(self._stated.lasting if axis <= NORTH else (), FIRST_ERROR // 2)
        return [axis, *(2 * index + axis for index, error in columns if state in error.states)]

    def start(self, position: float, heading: float, state: FixState | None, at: int) -> None:
        """Start at a known pose with these variances (m², rad²), keeping those of the biases.

        The lasting errors of the receiver have their stationary variance. If the position is that
        of a fix in `state` at `at` (ns), it also has the lasting errors of the fix.
        """
        variances = self.values.diagonal().copy()
        variances[:SPEED_BIAS] = position, position, heading
        self.values = p = np.diag(variances)
        self._since[:] = 0.0
        for index, error in enumerate(self._stated.lasting):
            self._restart(index, error.deviation)
        self._state, self._fixed_at = state, at
        if state is None:
            return
        for axis in (EAST, NORTH):
            for column in self._active(axis, state)[1:]:
                p[axis, axis] += p[column, column]
                p[axis, column] = p[column, axis] = -p[column, column]

    def grow(self, span: float, east: float, north: float, yaw: float, load_effect: float) -> None:
        """Predict over `span` (s) of dead reckoning, a displacement (m) from the direction `yaw`.

        `load_effect` (m) is the lateral displacement per relative error of the load. A change of
        heading has no effect within the step. Steps are collected for `STEP` (s), or up to a fix.
        """
        self._since += span, east, north, load_effect
        self._yaw = yaw
        if self._since[0] >= STEP:
            self._predict()

    def _predict(self) -> None:
        span, east, north, load_effect = self._since.tolist()
        self._since[:] = 0.0
        f, q, cos, sin = self._transition, self._noise, math.cos(self._yaw), math.sin(self._yaw)
        f[EAST, HEADING], f[NORTH, HEADING] = -north, east
        f[EAST, SPEED_BIAS], f[NORTH, SPEED_BIAS] = -cos * span, -sin * span
        f[EAST, LOAD], f[NORTH, LOAD] = -sin * load_effect, cos * load_effect
        f[HEADING, GYRO_BIAS] = -span
        along, across, turning = self._densities
        common, difference = across + self._stated.common_density, along - across
        q[EAST, EAST] = span * (common + difference * cos * cos)
        q[NORTH, NORTH] = span * (common + difference * sin * sin)
        q[EAST, NORTH] = q[NORTH, EAST] = span * difference * cos * sin
        q[HEADING, HEADING] = span * turning
        for index, error in enumerate(self._stated.lasting, FIRST_ERROR // 2):
            f[2 * index, 2 * index] = f[2 * index + 1, 2 * index + 1] = error.kept(span)
            q[2 * index, 2 * index] = q[2 * index + 1, 2 * index + 1] = error.growth(span)
        self._errors *= f.diagonal()
        self.values = np.einsum("ij,kj->ik", np.einsum("ij,jk->ik", f, self.values), f) + q

    def enter(self, state: FixState, at: int) -> None:
        """Predict to a fix in this state at `at` (ns), and restart the errors that it restarts."""
        if self._since[0] > 0.0:
            self._predict()
        entered = state != self._state or at - self._fixed_at > 1.5 * self._stated.period
        for index, error in enumerate(self._stated.lasting):
            if entered and state in error.states and error.entry_deviation is not None:
                self._restart(index, error.entry_deviation)
        self._state, self._fixed_at = state, at

    def _restart(self, index: int, deviation: float) -> None:
        """Make a lasting error independent of all others, with the given deviation (m)."""
        for column in (FIRST_ERROR + 2 * index, FIRST_ERROR + 2 * index + 1):
            self.values[column] = self.values[:, column] = self._errors[column] = 0.0
            self.values[column, column] = deviation**2

    def white_variance(self, fix: Fix) -> float:
        """Variance (m²) per axis of the white noise of a fix: its accuracy without other errors."""
        lasting = [one.deviation**2 for one in self._stated.lasting if fix.state in one.states]
        rest = fix.accuracy**2 - sum(lasting) - self._stated.common_variance
        return max(rest, self._stated.white[fix.state])

    def correct(
        self, state: FixState, off: Sequence[float], noise: Sequence[float], free: Sequence[float]
    ) -> list[float] | None:
        """Correct by a fix that is `off` the estimate in the first five states.

        `noise` has the variances of its white noise. The fix may be off by `free` (m, rad) beyond
        the gate; otherwise it is an outlier, and None is returned. Returns the corrections of the
        first five states.
        """
        columns, p, load = self._columns[state], self.values, self.values[LOAD, LOAD]
        measured = list(zip(off, columns, noise, strict=True))
        left = [value - sum([self._errors[k] for k in own]) for value, own, _ in measured]
        east, north, heading, *biases = [
            sum([p[k, j] for k in own for j in own]) + variance for _, own, variance in measured
        ]
        away, turned = math.hypot(left[EAST], left[NORTH]), abs(off[HEADING]) - free[1]
        if away > free[0] + GATE * math.sqrt(east + north) or turned > GATE * math.sqrt(heading):
            return None
        change = np.zeros(len(p))
        for index, (_, own, variance) in enumerate(measured):  # one after the other
            if index >= SPEED_BIAS and off[index] ** 2 > GATE**2 * biases[index - SPEED_BIAS]:
                continue
            gain = sum([p[k] for k in own], np.zeros(len(p)))
            total = sum([gain[k] for k in own]) + variance
            change += gain * ((left[index] - sum([change[k] for k in own])) / total)
            p -= gain[:, None] * gain / total
        p[LOAD, LOAD] = load  # considered, not estimated
        self._errors += change
        self._errors[:FIRST_ERROR] = 0.0
        corrections: list[float] = change[:MEASURED].tolist()
        return corrections

    def deviation(self, direction: float) -> float:
        """Standard deviation (m) in a direction (rad), with errors shared by all receivers."""
        p, cos, sin = self.values, math.cos(direction), math.sin(direction)
        square = cos * cos * p[EAST, EAST] + sin * sin * p[NORTH, NORTH]
        square += 2.0 * cos * sin * p[EAST, NORTH] + self._stated.common_variance
        return math.sqrt(max(square, 0.0))
