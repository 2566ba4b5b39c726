"""The lead's speed: lowered before curves, or as recorded."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.definition.road.silences import (
    LONG_SILENCE,
    RECORDED_STEP,
    SILENCE,
    SILENT_INTERVALS,
    with_silences,
)
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.sampled_path import FloatArray, SampledPath

STEP = 0.05
"""Time step (s) of a speed that depends on the station."""

RECORDED_WINDOW = 1.0
"""Averaging window (s) of recorded speeds."""

DERIVED_WINDOW = 2.0
"""Averaging window (s) of speeds derived from positions, which are noisier."""

WINDOW_PER_METRE = 4.0
"""The same per metre of their noise (s/m): a phone's noise looks like hard braking."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Greatest lateral acceleration, acceleration and braking of the lead (m/s², all positive)."""

    lateral: float
    acceleration: float
    braking: float


def slowed(
    wanted: SpeedProfile, path: SampledPath, start: float, limits: Limits, until: float
) -> SpeedProfile:
    """Lower `wanted` before and in curves, from station `start` (m), for `until` s or to the end.

    In a curve v² |curvature| stays at the lateral limit. The lead brakes early enough, and
    accelerates to the wanted speed after the curve.
    """
    fastest, sharpest = max(wanted.speeds), float(np.max(np.abs(path.curvature)))
    if fastest * fastest * sharpest <= limits.lateral:
        return wanted
    cap = _Cap(path, limits)
    station, at = start, 0.0
    speeds = [min(wanted.at(0.0)[0], cap.at(start))]
    while station < cap.end and at < until and not _standing(wanted, at, speeds[-1]):
        speed, at = speeds[-1], len(speeds) * STEP
        now, before = wanted.at(at)[0], wanted.at(at - STEP)[0]
        climb = max(limits.acceleration * STEP, now - before)
        speeds.append(min(now, speed + climb, cap.at(station + speed * STEP)))
        station += 0.5 * (speed + speeds[-1]) * STEP
    return SpeedProfile(tuple(k * STEP for k in range(len(speeds))), tuple(speeds))


class _Cap:
    """Highest speed at each station that leaves room to brake for all curves ahead."""

    def __init__(self, path: SampledPath, limits: Limits) -> None:
        sharp = np.maximum(np.abs(path.curvature), 1e-9)
        squares: list[float] = (limits.lateral / sharp).tolist()
        steps: list[float] = np.diff(path.station).tolist()
        for k in range(len(steps) - 1, -1, -1):
            squares[k] = min(squares[k], squares[k + 1] + 2.0 * limits.braking * steps[k])
        self._stations: list[float] = path.station.tolist()
        self._squares = squares
        self.end = self._stations[-1]

    def at(self, station: float) -> float:
        """Return the speed (m/s) at `station` (m); its square is linear, as under braking."""
        k = min(max(bisect_right(self._stations, station), 1), len(self._stations) - 1)
        (s0, s1), (q0, q1) = self._stations[k - 1 : k + 1], self._squares[k - 1 : k + 1]
        share = min(max((station - s0) / (s1 - s0), 0.0), 1.0)
        return math.sqrt(q0 + share * (q1 - q0))


def _standing(wanted: SpeedProfile, at: float, speed: float) -> bool:
    return speed == 0.0 and at >= wanted.times[-1] and wanted.speeds[-1] == 0.0


def recorded(
    times: Sequence[float],
    stations: Sequence[float],
    speeds: Sequence[float],
    noise: float = 0.0,
) -> tuple[SpeedProfile, float]:
    """Return the speed of a recorded drive over time, and the factor by which it was scaled.

    `stations` (m) are those of the recorded points on the smoothed path. Recorded `speeds` are
    scaled to cover the path exactly; without them, or in a silence, the speed follows from the
    stations, which have `noise` (m). Both are averaged over a window of a few intervals without
    silences; stops remain stops.
    """
    kept = np.flatnonzero(np.diff(np.asarray(times), prepend=-math.inf) > 0.0)
    t, s = np.asarray(times, float)[kept], np.asarray(stations, float)[kept]
    window = max(DERIVED_WINDOW, WINDOW_PER_METRE * noise)
    ratio, distance, gone = 1.0, s - s[0], np.diff(t)
    usual = float(np.median(gone)) if gone.size else 0.0
    silent = gone > max(SILENCE, SILENT_INTERVALS * usual)
    if len(speeds) > 0:
        v = np.asarray(speeds, float)[kept]
        driven = _summed(np.where(silent, 0.0, 0.5 * (v[1:] + v[:-1]) * gone))
        unseen = _summed(np.where(silent, np.diff(s), 0.0))
        seen = distance[-1] - unseen[-1]
        ratio = float(seen / driven[-1]) if driven[-1] > 0.0 else math.inf
        if ratio < math.inf:
            window, distance = RECORDED_WINDOW, driven * ratio + unseen
    t, distance = with_silences(t, distance, np.flatnonzero(silent).tolist())
    span = float(t[-1] - t[0])
    recorded_span = span - float(np.sum(gone[silent]))
    half = 0.5 * max(window, 3.0 * recorded_span / max(int(np.count_nonzero(~silent)), 1))
    knots = _knots(t - t[0], half)
    return SpeedProfile(
        tuple(knots.tolist()), tuple(_mean_speed(t - t[0], distance, knots, half))
    ), ratio


def _knots(t: FloatArray, half: float) -> FloatArray:
    """Return instants every RECORDED_STEP, without the middle of long intervals of `t` (s).

    There the mean speed within `half` s is constant.
    """
    last = math.ceil(t[-1] / RECORDED_STEP)
    long = np.flatnonzero(np.diff(t) > LONG_SILENCE + 2.0 * half)
    begins = np.append(0, np.floor((t[long + 1] - half) / RECORDED_STEP) - 1)
    ends = np.append(np.ceil((t[long] + half) / RECORDED_STEP) + 1, last)
    parts = [np.arange(begin, end + 1) for begin, end in zip(begins, ends, strict=True)]
    return np.concatenate(parts).astype(np.float64) * RECORDED_STEP


def _summed(steps: FloatArray) -> FloatArray:
    return np.concatenate((np.zeros(1), np.cumsum(steps)))


def _mean_speed(t: FloatArray, distance: FloatArray, knots: FloatArray, half: float) -> list[float]:
    """Return the mean speed (m/s) within `half` s of each knot, within the record."""
    late, early = np.minimum(knots + half, t[-1]), np.maximum(knots - half, 0.0)
    early = np.minimum(early, late - half)
    result: list[float] = (
        (np.interp(late, t, distance) - np.interp(early, t, distance)) / (late - early)
    ).tolist()
    return result
