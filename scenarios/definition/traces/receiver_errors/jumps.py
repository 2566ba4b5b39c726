"""Jumps of a receiver: points that no car can reach and leave in their time."""

import heapq
import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.definition.traces.receiver_errors.jump_suspects import (
    ABRUPT,
    LATE_STRAYS,
    LONG_STEP,
    LONGEST_JUMP,
    LONGEST_OFFSET,
    MOST_ACCELERATION,
    OFFSET_TIME,
    SPARSE,
    TIGHTEST,
    Floats,
    Ints,
    Track,
)
from vehicles.geometry.local_regression import cubic_weights

NEAR = 4
"""Number of points after a jump that are judged again."""

MANY_JUMPS = 1000
"""Number of jumps of single points that are removed at once."""

CLEAN_POINTS = (3, 2, 2, 2)
"""Number of plausible points on either side of such jumps, in each round of their removal."""

SIDE = LONGEST_JUMP + 1
"""Number of plausible points on either side of an offset, which is more than those of a jump."""


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

    `times` are empty if unknown, and late by 0 to `time_error_s`. MANY_JUMPS of single points are
    removed at once, because the search takes more time for each, and holds many for noise.
    """
    given, singles = np.asarray(times), dict[int, float]()
    left = np.arange(points.shape[1])
    finder = JumpFinder(points, given, time_error_s)
    for clean in CLEAN_POINTS:
        lone, sizes = finder.lone_jumps(clean)
        if len(singles) + lone.size < MANY_JUMPS:
            break
        singles |= zip(left[lone].tolist(), sizes.tolist(), strict=True)
        left = np.delete(left, lone)
        finder = JumpFinder(points[:, left], given[left] if given.size else given, time_error_s)
    jumps = [
        Jump(int(left[jump.first]), int(left[jump.last]), jump.size)
        for jump in finder.without_jumps()
    ]
    inside = np.zeros(points.shape[1], dtype=bool)
    for jump in jumps:
        inside[jump.first : jump.last + 1] = True
    jumps += [Jump(k, k, size) for k, size in singles.items() if not inside[k]]
    return sorted(jumps, key=lambda jump: jump.first), left[finder.kept]


class JumpFinder:
    """Removes jumps from points (2, n) with times (s), empty if unknown; `kept` are the others.

    Times are late by 0 to `time_error_s`. The search for suspects takes arrays; the few suspects
    are judged one by one, which is faster in Python than in arrays of a few points.
    """

    def __init__(
        self, points: Floats, times: Sequence[float] | Floats, time_error_s: float = 0.0
    ) -> None:
        count = points.shape[1]
        self.timed = len(times) > 0
        self.at = np.asarray(times if self.timed else range(count), dtype=np.float64)
        self._track = Track(points, self.at, time_error_s, timed=self.timed)
        self._x, self._y = _as_array(points[0]), _as_array(points[1])
        self._t, self._usual = _as_array(self.at), _as_array(self._track.usual)
        late = self._track.late
        self._late = None if late is None else _as_array(late)
        self._before = array("q", range(-1, count - 1))
        self._after = array("q", range(1, count + 1))
        self._removed = np.zeros(count, dtype=bool)

    def lone_jumps(self, clean: int) -> tuple[Ints, Floats]:
        return self._track.lone_jumps(clean)

    @property
    def kept(self) -> Ints:
        return np.flatnonzero(~self._removed)

    def without_jumps(self) -> list[Jump]:
        """Remove jumps and return them in order."""
        pending = self._track.suspects()  # in order: a heap
        # First, as a short jump could consume both sides of a step.
        result = [jump for k in pending.copy() if (jump := self._removed_at(k, self._offset_count))]
        for jump in result:
            self._suspect_again(jump, pending)
        while pending:
            jump = self._removed_at(heapq.heappop(pending), self._jump_count)
            if jump:
                result.append(jump)
                self._suspect_again(jump, pending)
        return sorted(result, key=lambda jump: jump.first)

    def _removed_at(self, k: int, count_at: Callable[[list[int], int], int]) -> Jump | None:
        """Remove and return a jump that begins at point k, if there is one."""
        if self._removed[k]:
            return None
        row, place = self._row(k)
        count = count_at(row, place)
        if not count:
            return None
        size = self._size(row, place, count)
        self._remove(row[place : place + count])
        return Jump(k, row[place + count - 1], size)

    def _suspect_again(self, jump: Jump, pending: list[int]) -> None:
        """Add points around a removed jump to the heap."""
        before, after = self._before[jump.first], self._after[jump.last]
        around = []
        for _ in range(2):
            if before >= 0:
                around.append(before)
                before = self._before[before]
        for number in range(NEAR):
            # The cubic through four points may have missed the jump.
            if after < len(self._t) and (number < 2 or self._track.near[after]):
                around.append(after)
            after = self._after[after] if after < len(self._t) else after
        for near in around:
            heapq.heappush(pending, near)

    def _remove(self, points: list[int]) -> None:
        self._removed[points] = True
        before, after = self._before[points[0]], self._after[points[-1]]
        if before >= 0:
            self._after[before] = after
        if after < len(self._t):
            self._before[after] = before

    def _row(self, k: int) -> tuple[list[int], int]:
        """Return the kept points around k, and its place among them."""
        row, near = [k], self._before[k]
        while len(row) <= SIDE and near >= 0:
            row.append(near)
            near = self._before[near]
        row.reverse()
        place, near = len(row) - 1, self._after[k]
        while len(row) <= place + LONGEST_OFFSET + SIDE and near < len(self._t):
            row.append(near)
            near = self._after[near]
        return row, place

    def _jump_count(self, row: list[int], place: int) -> int:
        """Return the number of points of the jump that begins at a place of the row, or 0."""
        last, before = len(row) - 1, place - 1
        if before < 0:
            off = self._excess(*_first_three(row)) > 0.0
            return int(off and self._is_plausible_without(row, -1, 1))
        for count in range(1, min(last - place, LONGEST_JUMP) + 1):
            after = place + count
            if self._are_off(row, place, after) and self._is_plausible_without(row, before, after):
                return count
            if count == 1 and self._strays(row, place):
                return 1
        return int(place == last and self._excess(*_first_three(row[::-1])) > 0.0)

    def _offset_count(self, row: list[int], place: int) -> int:
        """Return the number of points, above LONGEST_JUMP, of an offset that begins here, or 0.

        No car can do the steps at its ends, while the points within and around are plausible.
        """
        if not self.timed or place < SIDE:
            return 0
        if self._excess(row[place], row[place - 2], row[place - 1]) <= 0.0:
            return 0
        latest = self._t[row[place - 1]] + OFFSET_TIME
        for after in range(place + SIDE, min(place + LONGEST_OFFSET, len(row) - SIDE) + 1):
            if self._t[row[after]] > latest:
                break
            if (
                self._excess(row[after - 1], row[after], row[after + 1]) > 0.0
                and self._are_off(row, place, after)
                and self._are_plausible(row[place:after])
                and self._are_plausible(row[place - SIDE : place] + row[after : after + SIDE])
            ):
                return after - place
        return 0

    def _are_off(self, row: list[int], place: int, after: int) -> bool:
        """Whether the first and the last of the points up to `after` are off the line past them."""
        ends = row[place - 1], row[after]
        return all(self._excess(k, *ends) > 0.0 for k in (row[place], row[after - 1]))

    def _are_plausible(self, points: list[int]) -> bool:
        threes = zip(points, points[1:], points[2:], strict=False)
        return all(self._excess(b, a, c) <= 0.0 for a, b, c in threes)

    def _is_plausible_without(self, row: list[int], before: int, after: int) -> bool:
        """Whether the points around a gap are plausible without the points in it."""
        near = [*range(max(before - 2, 0), before + 1), *range(after, min(after + 3, len(row)))]
        return self._are_plausible([row[k] for k in near])

    def _strays(self, row: list[int], place: int) -> bool:
        """Whether a SPARSE point alone is too far from the cubic through its neighbours."""
        if not self.timed or not 2 <= place < len(row) - 2:
            return False
        k = row[place]
        interval = 0.5 * (self._t[row[place + 1]] - self._t[row[place - 1]])
        allowed = max(self._track.least, ABRUPT * interval * interval)
        if self._late is not None:
            allowed += LATE_STRAYS * self._late[k]
        if interval < SPARSE or self._off_cubic(row[place - 2 : place + 3]) <= allowed:
            return False
        others = [*row[max(0, place - 4) : place], *row[place + 1 : place + 5]]
        rows = (others[j : j + 5] for j in range(len(others) - 4))
        return all(self._off_cubic(five) <= allowed for five in rows)

    def _off_cubic(self, row: Sequence[int]) -> float:
        """Return the distance (m) of the third of five points from the cubic through the others.

        0 if times repeat.
        """
        at, four = self._t[row[2]], (row[0], row[1], row[3], row[4])
        t = [self._t[k] for k in four]
        if not t[0] < t[1] < at < t[2] < t[3]:
            return 0.0
        x, y = self._x[row[2]], self._y[row[2]]
        for weight, k in zip(cubic_weights(np.array(t), at).tolist(), four, strict=True):
            x -= weight * self._x[k]
            y -= weight * self._y[k]
        return math.hypot(x, y)

    def _offset(self, k: int, a: int, b: int) -> tuple[float, float]:
        """Return the distance (m) of point k from the line a to b at its time, and the limit."""
        x0, y0, x1, y1 = self._x[a], self._y[a], self._x[b], self._y[b]
        x, y = self._x[k], self._y[k]
        t0, t1, t = self._t[a], self._t[b], self._t[k]
        share = (t - t0) / (t1 - t0) if t1 != t0 else 0.5
        if not self.timed and a < k < b:  # by distance, because of holes
            before = math.hypot(x - x0, y - y0)
            share = before / max(before + math.hypot(x1 - x, y1 - y), 1e-9)
        beyond = max(1.0, abs(share), abs(1.0 - share))
        dx, dy = x - x0 - share * (x1 - x0), y - y0 - share * (y1 - y0)
        if self._late is not None:  # the place along the line is uncertain
            length = max(math.hypot(x1 - x0, y1 - y0), 1e-9)
            ux, uy = (x1 - x0) / length, (y1 - y0) / length
            along, across = dx * ux + dy * uy, dy * ux - dx * uy
            dx, dy = max(abs(along) - self._late[k] * beyond, 0.0), across
        off = math.hypot(dx, dy)
        if self.timed:
            curve = 0.5 * MOST_ACCELERATION * abs((t - t0) * (t - t1))
        else:
            curve = (math.hypot(x1 - x0, y1 - y0) * beyond) ** 2 / (8.0 * TIGHTEST)
        return off, max(self._track.least * beyond, curve)

    def _excess(self, k: int, a: int, b: int) -> float:
        """Return by how much (m) point k exceeds the limit between its neighbours a and b."""
        off, allowed = self._offset(k, a, b)
        if off > allowed and not self.timed and self._is_in_step(k, a) and self._is_in_step(k, b):
            return 0.0  # on a loop that is tight for its points
        return off - allowed

    def _is_in_step(self, k: int, other: int) -> bool:
        """Whether two points without times are a usual step apart."""
        apart = math.hypot(self._x[other] - self._x[k], self._y[other] - self._y[k])
        return apart <= LONG_STEP * self._usual[k] * abs(k - other)

    def _size(self, row: list[int], place: int, count: int) -> float:
        before, after = place - 1, place + count
        if place == 0:
            before, after = 1, 2
        elif after >= len(row):
            before, after = place - 2, place - 1
        a, b = (row[min(max(end, 0), len(row) - 1)] for end in (before, after))
        return max(self._offset(k, a, b)[0] for k in row[place : place + count])


def _first_three(row: list[int]) -> tuple[int, int, int]:
    """Return the first three points, the last of them repeated if there are fewer."""
    return row[0], row[min(1, len(row) - 1)], row[min(2, len(row) - 1)]


def _as_array(column: Floats) -> "array[float]":
    """Return a column whose items are Python's numbers."""
    return array("d", column.tobytes())
