"""Jumps of a receiver: points that no car can reach and leave in their time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vehicles.geometry.bridges import NEARBY, noise_deviation, step_lengths

LONGEST_JUMP = 10
"""Largest number of points of a jump."""

LEAST_JUMP = 0.5
"""Smallest distance (m) of a jump from its interpolated position."""

UNLIKELY = 6.0
"""Standard deviations of noise that a point practically never exceeds."""

MOST_ACCELERATION = 15.0
"""Largest acceleration (m/s²) of a car."""

TIGHTEST = 3.0
"""Smallest radius (m) that a car can turn."""

LONG_STEP = 1.5
"""Steps nearby that a jump of points without times exceeds."""

MOST_SUSPECTS = 0.35
"""Largest share of points next to a jump; with more they are noise, and the limit rises."""

MOST_ROUNDS = 20
"""Number of times that the remaining points are searched."""

SPEED_BLOCK = 20
"""Number of steps whose median is the local speed."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Jump:
    """Points `first` to `last` (from 0), up to `size` m off the drive."""

    first: int
    last: int
    size: float


def find_jumps(
    points: Floats, times: Sequence[float] | Floats, time_error_s: float = 0.0
) -> tuple[list[Jump], Ints]:
    """Return in order the jumps of points (2, n) with times (s), and the numbers of other points.

    `times` are empty if unknown, and late by 0 to `time_error_s`. Jumps of few points are removed
    first, and the others are searched again.
    """
    timed = len(times) > 0
    at = np.asarray(times if timed else range(points.shape[1]), dtype=np.float64)
    left, jumps = np.arange(points.shape[1]), list[Jump]()
    for _ in range(MOST_ROUNDS):
        track = _Track(points[:, left], at[left], time_error_s, timed=timed)
        found = track.jumps()
        if not found:
            break
        removed = np.zeros(left.size, dtype=bool)
        for jump in found:
            removed[jump.first : jump.last + 1] = True
            jumps.append(Jump(int(left[jump.first]), int(left[jump.last]), jump.size))
        left = left[~removed]
    return sorted(jumps, key=lambda jump: jump.first), left


class _Track:
    """Points (2, n) at times (s), or numbers, and the limits of their distances from each other.

    Times are late by 0 to `time_error_s`. `usual` is the median step (m) near each point without
    times; `late` the distance (m) by which it may be late, if any.
    """

    def __init__(self, points: Floats, at: Floats, time_error_s: float, *, timed: bool) -> None:
        self.count, self.timed, self.at = at.size, timed, at
        self.x, self.y = points
        self.least = max(LEAST_JUMP, UNLIKELY * noise_deviation(points))
        steps = step_lengths(points)
        self.usual = np.zeros(0) if timed else _medians_nearby(steps, self.count)
        self.late = time_error_s * _local_speeds(steps, at) if timed and time_error_s else None

    def jumps(self) -> list[Jump]:
        """Return jumps that do not touch each other, those of few points first."""
        taken = np.zeros(self.count, dtype=bool)
        suspects = self._suspects()
        result = self._jumps_at_ends() if self.count > LONGEST_JUMP else []
        for jump in result:
            taken[jump.first] = True
        for length in range(1, LONGEST_JUMP + 1):
            k = suspects[(suspects >= 2) & (suspects + length < self.count - 1)]
            k = k[self._excess(k, k - 1, k + length) > 0.0]
            k = k[self._excess(k + length - 1, k - 1, k + length) > 0.0]
            k = k[self._excess(k - 1, k - 2, k + length) <= 0.0]
            k = k[self._excess(k + length, k - 1, k + length + 1) <= 0.0]
            for first in k.tolist():
                around = slice(first - 1, first + length + 1)
                if taken[around].any():
                    continue
                taken[around] = True
                inside = np.arange(first, first + length)
                size = self._offset(inside, inside * 0 + first - 1, inside * 0 + first + length)[0]
                result.append(Jump(first, first + length - 1, float(size.max())))
        return result

    def _suspects(self) -> Ints:
        """Return the points off the line between their neighbours, and those next to such points.

        Many suspects are noise and raise the limit.
        """
        k = np.arange(1, self.count - 1)
        while True:
            odd = self._excess(k, k - 1, k + 1) > 0.0
            if not self.timed:
                odd |= ~self._is_in_step(k, k + 1)
            if not self.timed or np.count_nonzero(odd) <= MOST_SUSPECTS * self.count:
                break
            self.least *= 2.0
        near = np.zeros(self.count, dtype=bool)
        for shift in range(3):
            near[shift : self.count - 2 + shift] |= odd
        return np.flatnonzero(near)

    def _jumps_at_ends(self) -> list[Jump]:
        """Return the first and the last point if they are off the next three."""
        result = []
        for end, sign in ((0, 1), (self.count - 1, -1)):
            row = np.array([end + sign * k for k in range(4)])[:, None]
            is_off = self._excess(row[0], row[1], row[2])[0] > 0.0
            if is_off and self._excess(row[2], row[1], row[3])[0] <= 0.0:
                result.append(Jump(end, end, float(self._offset(row[0], row[1], row[2])[0][0])))
        return result

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

    def _is_in_step(self, k: Ints, other: Ints) -> Mask:
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
