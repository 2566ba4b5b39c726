"""Search of all points of a drive for the few at which a jump may begin."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vehicles.geometry.bridges import NEARBY, noise_deviation, step_lengths
from vehicles.geometry.local_regression import cubic_weights

LONGEST_JUMP = 10
"""Largest number of points of a jump..."""

LONGEST_OFFSET = 50
"""...and of a jump with times that ends within OFFSET_TIME."""

OFFSET_TIME = 5.0
"""Longest time (s) between the points around a jump of more than LONGEST_JUMP points."""

LEAST_JUMP = 0.5
"""Smallest distance (m) of a jump from its interpolated position."""

UNLIKELY = 6.0
"""Standard deviations of noise that a point practically never exceeds."""

MOST_ACCELERATION = 15.0
"""Largest acceleration (m/s²) of a car."""

SPARSE = 0.4
"""Interval (s) of sparse points, where a jump of metres looks like hard braking."""

ABRUPT = 2.0
"""Largest distance (m/s²) of a sparse point from the cubic through two points before and two after,
over its squared interval (s): the acceleration would change by 18 m/s²."""

TIGHTEST = 3.0
"""Smallest radius (m) that a car can turn."""

LONG_STEP = 1.5
"""Steps nearby that a jump of points without times exceeds."""

FEW_SUSPECTS = 10_000
"""Number of suspects that are checked in any case."""

MOST_SUSPECTS = 0.2
"""Largest share of points that are suspects; with more they are noise, and the limit rises."""

LATE_STRAYS = 1.5
"""Distance from the cubic of a point whose neighbours are late, by their distance."""

SPEED_BLOCK = 20
"""Number of steps whose median is the local speed."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Track:
    """Points (2, n) at times (s), or numbers, and the limits of their distances from each other.

    Times are late by 0 to `time_error_s`. Methods take arrays of points. `usual` is the median step
    (m) near each point without times; `late` the distance (m) by which it may be late, if any.
    `near` marks odd points and those next to them.
    """

    def __init__(self, points: Floats, at: Floats, time_error_s: float, *, timed: bool) -> None:
        self.count = at.size
        self.near = np.zeros(self.count, dtype=bool)
        self.timed = timed
        self.x, self.y = points
        self.at = at
        self.least = max(LEAST_JUMP, UNLIKELY * noise_deviation(points))
        steps = step_lengths(points)
        self.usual = np.zeros(0) if timed else _medians_nearby(steps, self.count)
        self.late = time_error_s * _local_speeds(steps, at) if timed and time_error_s else None

    def lone_jumps(self, clean: int) -> tuple[Ints, Floats]:
        """Return the single points that jump, with `clean` plausible points on either side.

        The second value is how far (m) they jump.
        """
        k = np.arange(clean, self.count - clean)
        k = k[self._excess(k, k - 1, k + 1) > 0.0]
        around = [*range(-clean, 0), *range(1, clean + 1)]
        for before, middle, after in zip(around, around[1:], around[2:], strict=False):
            k = k[self._excess(k + middle, k + before, k + after) <= 0.0]
        return k, self._offset(k, k - 1, k + 1)[0]

    def suspects(self) -> list[int]:
        """Return in order the points at which a jump may begin, ends of the drive included.

        They are off the line between their neighbours, or next to such points. Many suspects are
        noise and raise the limit.
        """
        most = max(FEW_SUSPECTS, MOST_SUSPECTS * self.count)
        k = np.arange(1, self.count - 1)
        while True:
            straying = self._straying()
            odd = self._excess(k, k - 1, k + 1) > 0.0
            odd[straying - 1] = True
            if not self.timed:
                odd |= ~self._is_in_step(k, k + 1)
            near = np.zeros(self.count, dtype=bool)
            for shift in range(3):
                near[shift : self.count - 2 + shift] |= odd
            begun = self._beginning(np.flatnonzero(near))
            if begun.size <= most:
                self.near = near
                return sorted({0, *begun.tolist(), *straying.tolist(), self.count - 1})
            distances = self._offset(k, k - 1, k + 1)[0]
            self.least = max(2.0 * self.least, float(np.quantile(distances, 1.0 - MOST_SUSPECTS)))

    def _beginning(self, k: Ints) -> Ints:
        """Return those of the points k where a jump of any length may begin."""
        k = k[(k > 0) & (k < self.count - 1)]
        found: list[Ints] = []
        for count in range(1, LONGEST_OFFSET + 1):
            k = k[k + count < self.count]
            if count == LONGEST_JUMP + 1:
                k = k[k > 1]
                k = k[self._excess(k, k - 2, k - 1) > 0.0]
            if count > LONGEST_JUMP:
                k = k[self.timed & (self.at[k + count] - self.at[k - 1] <= OFFSET_TIME)]
            if not k.size:
                break
            off = self._excess(k, k - 1, k + count) > 0.0
            off[off] = self._excess(k[off] + count - 1, k[off] - 1, k[off] + count) > 0.0
            found.append(k[off])
            k = k[~off]
        return np.concatenate(found) if found else k

    def _straying(self) -> Ints:
        """Return SPARSE points that alone are too far from the cubic through their neighbours."""
        if not self.timed:
            return np.zeros(0, dtype=np.int64)
        k = np.arange(2, self.count - 2)
        k = k[0.5 * (self.at[k + 1] - self.at[k - 1]) >= SPARSE]
        off, allowed = self._off_cubic(k + np.arange(-2, 3)[:, None])
        k, allowed = k[off > allowed], allowed[off > allowed]
        others = np.array([-4, -3, -2, -1, 1, 2, 3, 4])
        alone = np.ones(k.size, dtype=bool)
        for first in range(4):
            row = k + others[first : first + 5, None]
            outside = (row[0] < 0) | (row[4] >= self.count)
            alone &= outside | (self._off_cubic(row.clip(0, self.count - 1))[0] <= allowed)
        return np.asarray(k[alone])

    def _off_cubic(self, row: Ints) -> tuple[Floats, Floats]:
        """Return the distance (m) of the third of five points from the cubic through the others.

        It is 0 if times repeat. The second value is the limit.
        """
        at, four = self.at[row[2]], row[[0, 1, 3, 4]]
        t = self.at[four]
        ordered = (t[0] < t[1]) & (t[1] < at) & (at < t[2]) & (t[2] < t[3])
        x, y = self.x[row[2]], self.y[row[2]]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for weight, k in zip(cubic_weights(t, at), four, strict=True):
                x = x - weight * self.x[k]
                y = y - weight * self.y[k]
            off = np.where(ordered, np.hypot(x, y), 0.0)
        interval = 0.5 * (t[2] - t[1])
        allowed = np.maximum(self.least, ABRUPT * interval * interval)
        if self.late is not None:
            allowed = allowed + LATE_STRAYS * self.late[row[2]]
        return off, allowed

    def _offset(self, k: Ints, a: Ints, b: Ints) -> tuple[Floats, Floats]:
        """Return the distance (m) of point k from the line a to b at its time, and the limit."""
        x0, y0, t0, t = self.x[a], self.y[a], self.at[a], self.at[k]
        dx, dy, dt = self.x[b] - x0, self.y[b] - y0, self.at[b] - t0
        x, y = self.x[k] - x0, self.y[k] - y0
        share = np.where(dt != 0.0, (t - t0) / np.where(dt != 0.0, dt, 1.0), 0.5)
        if not self.timed:  # by distance, because of holes
            before = np.hypot(x, y)
            along = before / np.maximum(before + np.hypot(dx - x, dy - y), 1e-9)
            share = np.where((a < k) & (k < b), along, share)
        beyond = np.maximum(1.0, np.maximum(np.abs(share), np.abs(1.0 - share)))
        x, y = x - share * dx, y - share * dy
        if self.late is not None:  # along the line, times do not tell
            length = np.maximum(np.hypot(dx, dy), 1e-9)
            along, across = (x * dx + y * dy) / length, (y * dx - x * dy) / length
            x, y = np.maximum(np.abs(along) - self.late[k] * beyond, 0.0), across
        if self.timed:
            curve = 0.5 * MOST_ACCELERATION * np.abs((t - t0) * (t - t0 - dt))
        else:
            curve = (np.hypot(dx, dy) * beyond) ** 2 / (8.0 * TIGHTEST)
        return np.hypot(x, y), np.maximum(self.least * beyond, curve)

    def _excess(self, k: Ints, a: Ints, b: Ints) -> Floats:
        """Return by how much (m) point k exceeds the limit between its neighbours a and b."""
        off, allowed = self._offset(k, a, b)
        excess = off - allowed
        if self.timed:
            return excess
        # A loop may be tight for its points.
        return np.where(self._is_in_step(k, a) & self._is_in_step(k, b), 0.0 * excess, excess)

    def _is_in_step(self, k: Ints, other: Ints) -> NDArray[np.bool_]:
        """Whether two points without times are a usual step apart."""
        apart = np.hypot(self.x[other] - self.x[k], self.y[other] - self.y[k])
        return np.asarray(apart <= LONG_STEP * self.usual[k] * np.abs(k - other))


def _local_speeds(steps: Floats, at: Floats) -> Floats:
    """Return the local speed (m/s) per point."""
    gone = np.diff(at)
    speed = np.where(gone > 0.0, steps / np.where(gone > 0.0, gone, 1.0), np.nan)
    whole = np.full(-(-at.size // SPEED_BLOCK) * SPEED_BLOCK, np.nan)
    whole[: speed.size] = speed
    blocks = whole.reshape(-1, SPEED_BLOCK)
    blocks[np.all(np.isnan(blocks), axis=1)] = 0.0
    return np.repeat(np.nanmedian(blocks, axis=1), SPEED_BLOCK)[: at.size]


def _medians_nearby(steps: Floats, count: int) -> Floats:
    """Return the median of the NEARBY steps before and after each of `count` points."""
    result = np.empty(count)
    ends = {*range(min(NEARBY, count)), *range(max(0, count - NEARBY), count)}
    for k in ends:
        result[k] = np.median(steps[max(0, k - NEARBY) : k + NEARBY])
    for begin in range(NEARBY, count - NEARBY, 50_000):
        end = min(begin + 50_000, count - NEARBY)
        windows = sliding_window_view(steps[begin - NEARBY : end + NEARBY - 1], 2 * NEARBY)
        result[begin:end] = np.median(windows, axis=1)
    return result
