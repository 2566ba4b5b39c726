"""How fast the lead goes: as set, lowered before curves, or as it was recorded."""

import itertools
import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.path import Path

STEP = 0.05
"""Time step (s) with which a speed that depends on the place is laid out over time."""

RECORDED_STEP = 0.2
"""Time step (s) between the knots of a recorded speed."""

RECORDED_WINDOW = 1.0
"""Recorded speeds are averaged over this time (s)..."""

DERIVED_WINDOW = 2.0
"""...and speeds derived from recorded times over this (s), since positions are noisier."""


@dataclass(frozen=True, slots=True)
class SpeedPlan:
    """Speeds (m/s) at times (s) from the start, linear between and constant after the last."""

    times: tuple[float, ...]
    speeds: tuple[float, ...]

    def at(self, seconds: float) -> float:
        """Speed (m/s) at `seconds`."""
        index = bisect_right(self.times, seconds)
        if index in {0, len(self.times)}:
            return self.speeds[max(index - 1, 0)]
        (t0, t1), (v0, v1) = self.times[index - 1 : index + 1], self.speeds[index - 1 : index + 1]
        return v0 + (v1 - v0) * (seconds - t0) / (t1 - t0)

    def distance(self, seconds: float) -> float:
        """Way (m) driven in `seconds`."""
        inner = [time for time in self.times if 0.0 < time < seconds]
        ways = itertools.pairwise((0.0, *inner, seconds))
        return sum(0.5 * (self.at(begin) + self.at(end)) * (end - begin) for begin, end in ways)

    def time_to(self, distance: float) -> float:
        """Time (s) after which `distance` (m) is driven; infinite if the lead stops before."""
        driven = 0.0
        for begin, end in itertools.pairwise((0.0, *(t for t in self.times if t > 0.0))):
            way = 0.5 * (self.at(begin) + self.at(end)) * (end - begin)
            if driven + way >= distance:
                slope = (self.at(end) - self.at(begin)) / (end - begin)
                rest, speed = distance - driven, self.at(begin)
                root = math.sqrt(max(speed * speed + 2.0 * slope * rest, 0.0))
                return begin + 2.0 * rest / (speed + root) if speed + root > 0.0 else begin
            driven += way
        last = self.speeds[-1]
        return self.times[-1] + (distance - driven) / last if last > 0.0 else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Greatest lateral acceleration, acceleration and braking of the lead (m/s², all positive)."""

    lateral: float
    acceleration: float
    braking: float


def slowed(plan: SpeedPlan, path: Path, start: float, limits: Limits, until: float) -> SpeedPlan:
    """Lower `plan` before and in curves, from station `start` (m), for `until` s or to the end.

    In a curve v² |curvature| stays at the lateral limit; braking begins early enough, and after
    the curve the lead speeds up again to what is planned for that time.
    """
    fastest, sharpest = max(plan.speeds), float(np.max(np.abs(path.curvature)))
    if fastest * fastest * sharpest <= limits.lateral:
        return plan
    cap = _Cap(path, limits)
    station, at = start, 0.0
    speeds = [min(plan.at(0.0), cap.at(start))]
    while station < cap.end and at < until and not _standing(plan, at, speeds[-1]):
        speed, at = speeds[-1], len(speeds) * STEP
        climb = max(limits.acceleration * STEP, plan.at(at) - plan.at(at - STEP))
        speeds.append(min(plan.at(at), speed + climb, cap.at(station + speed * STEP)))
        station += 0.5 * (speed + speeds[-1]) * STEP
    return SpeedPlan(tuple(k * STEP for k in range(len(speeds))), tuple(speeds))


class _Cap:
    """Highest speed at each station from which all that follows on the path can be kept."""

    def __init__(self, path: Path, limits: Limits) -> None:
        sharp = np.maximum(np.abs(path.curvature), 1e-9)
        squares: list[float] = (limits.lateral / sharp).tolist()
        steps: list[float] = np.diff(path.station).tolist()
        for k in range(len(steps) - 1, -1, -1):
            squares[k] = min(squares[k], squares[k + 1] + 2.0 * limits.braking * steps[k])
        self._stations: list[float] = path.station.tolist()
        self._squares = squares
        self.end = self._stations[-1]

    def at(self, station: float) -> float:
        """Speed (m/s) at `station` (m); its square is linear in between, as under braking."""
        k = min(max(bisect_right(self._stations, station), 1), len(self._stations) - 1)
        (s0, s1), (q0, q1) = self._stations[k - 1 : k + 1], self._squares[k - 1 : k + 1]
        share = min(max((station - s0) / (s1 - s0), 0.0), 1.0)
        return math.sqrt(q0 + share * (q1 - q0))


def _standing(plan: SpeedPlan, at: float, speed: float) -> bool:
    """Tell whether the lead has stopped for good."""
    return speed == 0.0 and at >= plan.times[-1] and plan.speeds[-1] == 0.0


def recorded(
    times: Sequence[float], stations: Sequence[float], speeds: Sequence[float]
) -> tuple[SpeedPlan, float]:
    """Lay out the speed of a recorded drive over time, and the ratio by which it was scaled.

    `stations` (m) are the recorded points' places on the smoothed path, so the way driven never
    drifts from the path: recorded `speeds` are scaled to cover it exactly, and where there are
    none the speed is that of the stations. Both are averaged over a window; stops remain stops.
    """
    kept = np.flatnonzero(np.diff(np.asarray(times), prepend=-math.inf) > 0.0)
    t, s = np.asarray(times, float)[kept], np.asarray(stations, float)[kept]
    window, ratio, way = DERIVED_WINDOW, 1.0, s - s[0]
    if len(speeds) > 0:
        v = np.asarray(speeds, float)[kept]
        driven = np.concatenate((np.zeros(1), np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))))
        ratio = float(way[-1] / driven[-1]) if driven[-1] > 0.0 else math.inf
        window, way = RECORDED_WINDOW, driven * ratio
    span = float(t[-1] - t[0])
    knots = np.arange(math.ceil(span / RECORDED_STEP) + 1, dtype=np.float64) * RECORDED_STEP
    half = 0.5 * max(window, 3.0 * span / max(t.size - 1, 1))
    return SpeedPlan(tuple(knots.tolist()), tuple(_mean_speed(t - t[0], way, knots, half))), ratio


def _mean_speed(
    t: NDArray[np.float64], way: NDArray[np.float64], knots: NDArray[np.float64], half: float
) -> list[float]:
    """Mean speed (m/s) within `half` s of each knot, within the record's time."""
    late, early = np.minimum(knots + half, t[-1]), np.maximum(knots - half, 0.0)
    early = np.minimum(early, late - half)
    found: list[float] = (
        (np.interp(late, t, way) - np.interp(early, t, way)) / (late - early)
    ).tolist()
    return found
