"""The lead's speed: lowered before curves, or as recorded."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np

from scenarios.definition.schema.change_tables import AnyChange, SpeedChangeTable
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.sampled_path import FloatArray, SampledPath

# ---- Silences of a record: what the lead does where a recorded drive has no points for a while


RECORDED_STEP = 0.2
"""Time step (s) between the knots of a recorded speed."""

SILENCE, SILENT_INTERVALS = 2.0, 4.0
"""A silence in a record is longer than this (s) and than this number of usual intervals."""

LONG_SILENCE = 60.0
"""Interval (s) of points above which its middle has no knots."""

SILENT_BRAKING, SILENT_ACCELERATION = 2.5, 1.5
"""Assumed braking and acceleration (m/s²) of a car that was slower during a silence."""

CRAWLING = 1.0
"""Speed (m/s) below which a car is assumed to stand for a part of a silence."""

LONG_STOP, UNSTOPPED = 10.0, 3.0
"""Shortest silence (s) that is a stop if the car hardly moved in it, and the speed (m/s) next to it
above which its braking and acceleration were not recorded."""

FARTHEST = 500.0
"""Distance (m) within which the car brakes or accelerates."""


def with_silences(
    t: FloatArray, distance: FloatArray, silent: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Insert instants into silences in which the car slowed down, each given by its first point.

    Around a silence at speed in which the car hardly moved it brakes before and accelerates after.
    """
    t = t.copy()

    def speed(begin: float, end: float) -> float:
        here, there = np.interp((begin, end), t, distance).tolist()
        return (there - here) / (end - begin) if end > begin else 0.0

    times, places = [t], [distance]
    for k in silent:
        begin, end = t[k : k + 2].tolist()
        first = speed(max(begin - SILENCE, float(t[0])), begin)
        last = speed(end, min(end + SILENCE, float(t[-1])))
        driven = float(distance[k + 1] - distance[k])
        if (
            end - begin >= LONG_STOP
            and max(first, last) > UNSTOPPED
            and driven < UNSTOPPED * SILENCE
        ):
            _stop(t, distance, k)
            continue
        since, covered = _slowed_down(end - begin, driven, first, last)
        times.append(begin + since)
        places.append(distance[k] + covered)
    at = np.concatenate(times)
    order = np.argsort(at, kind="stable")
    return at[order], np.concatenate(places)[order]


def _stop(t: FloatArray, distance: FloatArray, k: int) -> None:
    """Let the car brake to the point before silence k and accelerate from the one after.

    A recording that was paused at speed has no braking. The time it takes is that of the silence:
    nothing changes if that is too short.
    """
    before = slice(max(0, int(np.searchsorted(distance, distance[k] - FARTHEST))), k + 1)
    after = slice(k + 1, int(np.searchsorted(distance, distance[k + 1] + FARTHEST, "right")))
    braking = np.sqrt(2.0 / SILENT_BRAKING * (distance[k] - distance[before]))
    speeding = np.sqrt(2.0 / SILENT_ACCELERATION * (distance[after] - distance[k + 1]))
    stopped, started = t[before] + braking, t[after] - speeding
    last, first = int(np.argmax(stopped)), int(np.argmin(started))
    if stopped[last] >= started[first]:
        return
    t[before][last:] = stopped[last] - braking[last:]
    t[after][: first + 1] = started[first] + speeding[: first + 1]


def _slowed_down(
    span: float, driven: float, first: float, last: float
) -> tuple[FloatArray, FloatArray]:
    """Return instants (s) in a `span`, and the distance (m) of `driven` covered by then.

    The car brakes from `first` (m/s) to a speed that it holds, and accelerates to `last`. Instead
    of CRAWLING it brakes later and stands. Empty if it was not slower, or braked harder.
    """
    # With a held speed h: driven = h * spare + h² * change + ramps.
    spare = span - first / SILENT_BRAKING - last / SILENT_ACCELERATION
    change = 0.5 / SILENT_BRAKING + 0.5 / SILENT_ACCELERATION
    ramps = 0.5 * first**2 / SILENT_BRAKING + 0.5 * last**2 / SILENT_ACCELERATION
    if spare <= 0.0 or ramps > driven:
        return np.zeros(0), np.zeros(0)
    level = driven - ramps
    held = 2.0 * level / (spare + math.sqrt(spare**2 + 4.0 * change * level))
    on = 0.0
    if held >= min(first, last):
        return np.zeros(0), np.zeros(0)
    if 0.0 < held < CRAWLING and level <= first * spare:
        held, on = 0.0, level / first
    braking, speeding = (first - held) / SILENT_BRAKING, (last - held) / SILENT_ACCELERATION
    since = np.arange(RECORDED_STEP, span, RECORDED_STEP)
    if span > LONG_SILENCE:  # without the middle, where it holds its speed
        since = since[(since < on + braking + 1.0) | (since > span - speeding - 1.0)]
    slowing = np.maximum(on + braking - np.maximum(since, on), 0.0)
    before = first * np.minimum(since, on) + 0.5 * SILENT_BRAKING * (braking**2 - slowing**2)
    after = 0.5 * SILENT_ACCELERATION * np.maximum(since - (span - speeding), 0.0) ** 2
    return since, before + held * np.maximum(since - on, 0.0) + after


# ---- Lead speed


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


# ---- The lead's speed after a change of its set speed, and the speed of a car that sets off


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpeedPlan:
    """The speed of a convoy over the time (s) of a run.

    `wanted` is the configured speed, `profile` the lead's after it is lowered in curves. The lead
    starts at station `start` (m) of the `path`. The plan covers the time to `until` (s).
    """

    path: SampledPath
    start: float
    limits: Limits
    until: float
    wanted: SpeedProfile
    profile: SpeedProfile

    def changed(self, at: float, change: SpeedChangeTable) -> "SpeedPlan":
        """Plan another set speed from `at` (s) on."""
        return _changed(self, at, change)

    def setting_off(self, at: float, station: float, speed: float) -> SpeedProfile:
        """Return the speed of a car on its own that is at `station` (m) with `speed` (m/s) at `at`.

        It accelerates like the lead, and slows down before curves.
        """
        wanted = _from(self.wanted, at)
        onward = self.onward(wanted, at, (station, speed), self.limits.acceleration)
        return _from(onward, at)

    def onward(
        self, wanted: SpeedProfile, at: float, here: tuple[float, float], acceleration: float
    ) -> SpeedProfile:
        """Return the speed from `at` (s) on of a car that is `here` (station m, speed m/s)."""
        station, speed = here
        reached = approached(_shifted(wanted, -at), speed, acceleration)
        if station >= float(self.path.station[-1]):
            return _shifted(reached, at)
        span = max(self.until - at, 0.0)
        return _shifted(slowed(reached, self.path, station, self.limits, span), at)


@lru_cache(maxsize=16)
def _changed(plan: SpeedPlan, at: float, change: SpeedChangeTable) -> SpeedPlan:
    """Compute a changed plan; cached, since it takes tens of milliseconds on a road with curves."""
    wanted = _from(SpeedProfile((0.0,), (change.speed_mps,)), at)
    here = plan.start + plan.profile.distance(at), plan.profile.at(at)[0]
    onward = plan.onward(wanted, at, here, change.acceleration_mps2)
    return replace(
        plan,
        wanted=_joined(plan.wanted, wanted, at),
        profile=_joined(plan.profile, onward, at),
    )


def approached(wanted: SpeedProfile, speed: float, acceleration: float) -> SpeedProfile:
    """Return the speed from time 0 on of a car that changes evenly from `speed` to `wanted`."""
    first = wanted.at(0.0)[0]
    slope = math.copysign(acceleration, first - speed)
    corners = [0.0, *(time for time in wanted.times if time > 0.0)]
    for begin, end in pairwise((*corners, math.inf)):
        aim, change = wanted.at(begin)
        apart = aim - (speed + slope * begin)
        closing = slope - change
        if apart == 0.0:
            met = begin
        elif apart * closing <= 0.0:
            continue
        else:
            met = begin + apart / closing
        if met <= end:
            after = [time for time in corners if time > met]
            begins = [(0.0, speed)] if met > 0.0 else []
            knots = [*begins, *((time, wanted.at(time)[0]) for time in (met, *after))]
            return SpeedProfile(*map(tuple, zip(*knots, strict=True)))
    return wanted


def with_changes(plan: SpeedPlan, changes: Iterable[AnyChange]) -> SpeedPlan:
    speeds = [change for change in changes if isinstance(change, SpeedChangeTable)]
    for change in sorted(speeds, key=lambda one: one.at_s):
        plan = plan.changed(change.at_s, change)
    return plan


def _shifted(profile: SpeedProfile, by: float) -> SpeedProfile:
    # Knots closer than the resolution of the shifted times become one.
    knots = {t + by: v for t, v in zip(profile.times, profile.speeds, strict=True)}
    return SpeedProfile(tuple(knots), tuple(knots.values()))


def _from(profile: SpeedProfile, at: float) -> SpeedProfile:
    """Return the part of a profile from `at` (s) on."""
    later = [(t, v) for t, v in zip(profile.times, profile.speeds, strict=True) if t > at]
    knots = [(at, profile.at(at)[0]), *later]
    return SpeedProfile(*map(tuple, zip(*knots, strict=True)))


def _joined(before: SpeedProfile, after: SpeedProfile, at: float) -> SpeedProfile:
    knots = [(t, v) for t, v in zip(before.times, before.speeds, strict=True) if t < at]
    if not knots or after.at(at)[0] != before.at(at)[0]:
        # Profiles have no jumps, but corners a nanosecond apart.
        last = at - 1e-9
        knots = [one for one in knots if one[0] < last] + (
            [(last, before.at(last)[0])] if last > 0.0 else []
        )
    later = [(t, v) for t, v in zip(after.times, after.speeds, strict=True) if t > at]
    knots += [(at, after.at(at)[0]), *later]
    return SpeedProfile(*map(tuple, zip(*knots, strict=True)))
