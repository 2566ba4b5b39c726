"""Jumps of a receiver: points that no car can reach and leave in their time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.bridges import NEARBY, noise_deviation, step_lengths
from vehicles.geometry.local_regression import cubic_weights

LONGEST_JUMP = 10
"""Largest number of points of a jump."""

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

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Jump:
    """Points `first` to `last` (from 0), up to `size` m off the drive."""

    first: int
    last: int
    size: float


class JumpFinder:
    """Removes jumps from points (2, n) with times (s), () if unknown; `kept` are the others."""

    def __init__(self, points: Floats, times: Sequence[float]) -> None:
        self.points = points
        self.timed = bool(times)
        count = points.shape[1]
        self.at = np.asarray(times if self.timed else range(count), dtype=np.float64)
        self.kept = list(range(count))
        self._xy = list(zip(*points.tolist(), strict=True))
        self._t = self.at.tolist()
        self._steps = step_lengths(points)
        self._least = max(LEAST_JUMP, UNLIKELY * noise_deviation(points))

    def without_jumps(self) -> list[Jump]:
        result: list[Jump] = []
        place = 0
        suspects = set(self._suspects())
        while place < len(self.kept):
            jump = self._jump(place) if self.kept[place] in suspects else None
            if jump is None:
                place += 1
                continue
            result.append(
                Jump(self.kept[place], self.kept[place + jump - 1], self._size(place, jump))
            )
            around = self.kept[max(0, place - 2) : place + jump + 2]
            del self.kept[place : place + jump]
            suspects.update(around)
            place = max(0, place - 2)
        return result

    def _suspects(self) -> list[int]:
        """Return points off the line between their neighbours, and the points next to them."""
        count = len(self.kept)
        odd = [
            k for k in range(1, count - 1) if self._excess(k, k - 1, k + 1) > 0.0 or self._strays(k)
        ]
        if not self.timed:
            odd += [k for k in range(1, len(self.kept) - 1) if not self._is_in_step(k, k + 1)]
        ends = [0, len(self.kept) - 1]
        return [*ends, *(near for k in odd for near in (k - 1, k, k + 1))]

    def _jump(self, place: int) -> int | None:
        last = len(self.kept) - 1
        for count in range(1, LONGEST_JUMP + 1):
            before, after = place - 1, place + count
            if after > last:
                break
            ends = {place, place + count - 1}
            if before < 0:
                off = count == 1 and self._excess(self._k(0), self._k(1), self._k(2)) > 0.0
            else:
                off = all(
                    self._excess(self._k(k), self._k(before), self._k(after)) > 0.0 for k in ends
                )
            if off and self._is_plausible_without(before, after):
                return count
            if count == 1 and self._strays(place):
                return 1
        if place == last and self._excess(*(self._k(last - k) for k in range(3))) > 0.0:
            return 1
        return None

    def _k(self, place: int) -> int:
        return self.kept[min(max(place, 0), len(self.kept) - 1)]

    def _is_plausible_without(self, before: int, after: int) -> bool:
        """Whether the points around a gap are plausible without the points in it."""
        row = [k for k in (before - 2, before - 1, before, after, after + 1, after + 2) if k >= 0]
        row = [k for k in row if k < len(self.kept)]
        threes = zip(row, row[1:], row[2:], strict=False)
        return all(self._excess(self._k(b), self._k(a), self._k(c)) <= 0.0 for a, b, c in threes)

    def _strays(self, place: int) -> bool:
        """Whether a SPARSE point alone is too far from the cubic through its neighbours."""
        if not self.timed or not 2 <= place < len(self.kept) - 2:
            return False
        row = self.kept[place - 2 : place + 3]
        interval = 0.5 * (self._t[row[3]] - self._t[row[1]])
        allowed = max(self._least, ABRUPT * interval * interval)
        if interval < SPARSE or self._off_cubic(row) <= allowed:
            return False
        others = [*self.kept[max(0, place - 4) : place], *self.kept[place + 1 : place + 5]]
        rows = (others[k : k + 5] for k in range(len(others) - 4))
        return all(self._off_cubic(row) <= allowed for row in rows)

    def _off_cubic(self, row: Sequence[int]) -> float:
        """Return the distance (m) of the third of five points from the cubic through the others.

        0 if times repeat.
        """
        at, four = self._t[row[2]], (row[0], row[1], row[3], row[4])
        t = [self._t[k] for k in four]
        if not t[0] < t[1] < at < t[2] < t[3]:
            return 0.0
        x, y = self._xy[row[2]]
        for weight, k in zip(cubic_weights(np.array(t), at).tolist(), four, strict=True):
            x -= weight * self._xy[k][0]
            y -= weight * self._xy[k][1]
        return math.hypot(x, y)

    def _offset(self, k: int, a: int, b: int) -> tuple[float, float]:
        """Return the distance (m) of point k from the line a to b at its time, and the limit."""
        (x0, y0), (x1, y1), (x, y) = self._xy[a], self._xy[b], self._xy[k]
        t0, t1, t = self._t[a], self._t[b], self._t[k]
        share = (t - t0) / (t1 - t0) if t1 != t0 else 0.5
        if not self.timed and a < k < b:  # by distance, because of holes
            before = math.hypot(x - x0, y - y0)
            share = before / max(before + math.hypot(x1 - x, y1 - y), 1e-9)
        beyond = max(1.0, abs(share), abs(1.0 - share))
        off = math.hypot(x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0))
        if self.timed:
            curve = 0.5 * MOST_ACCELERATION * abs((t - t0) * (t - t1))
        else:
            curve = (math.hypot(x1 - x0, y1 - y0) * beyond) ** 2 / (8.0 * TIGHTEST)
        return off, max(self._least * beyond, curve)

    def _excess(self, k: int, a: int, b: int) -> float:
        """Return by how much (m) point k exceeds the limit between its neighbours a and b."""
        off, allowed = self._offset(k, a, b)
        if off > allowed and not self.timed and self._is_in_step(k, a) and self._is_in_step(k, b):
            return 0.0  # on a loop that is tight for its points
        return off - allowed

    def _is_in_step(self, k: int, other: int) -> bool:
        """Whether two points without times are a usual step apart."""
        steps = self._steps[max(0, k - NEARBY) : k + NEARBY]
        (x0, y0), (x1, y1) = self._xy[k], self._xy[other]
        usual = LONG_STEP * float(np.median(steps)) * abs(k - other)
        return bool(np.hypot(x1 - x0, y1 - y0) <= usual)

    def _size(self, place: int, count: int) -> float:
        before, after = self._k(place - 1), self._k(place + count)
        if place == 0:
            before, after = self._k(1), self._k(2)
        elif place + count >= len(self.kept):
            before, after = self._k(place - 2), self._k(place - 1)
        return max(self._offset(self._k(k), before, after)[0] for k in range(place, place + count))
