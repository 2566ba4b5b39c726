"""What was heard of one source: its samples in their order of travel, and how far the ego is.

The ego's place on the trace is a station (arc length) that moves only locally from one call to the
next. Whatever lies close by in the plane but far along the trace (the other leg of a hairpin, the
crossing of a figure of eight, an earlier or later lap) is therefore never looked at.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from math import ceil, cos, hypot, inf, isfinite, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BRIDGE_AT = -1
"""`measured_at` of bridge points: before any sample."""
FORGET_CHUNK = 64
"""Samples behind the ego are forgotten so many at a time."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSettings:
    """Constants of a trace (m unless said otherwise).

    A sample is kept if it lies `spacing` from the one before (a stopped source repeats itself).
    A fix is a jump if it lies further from the newest one than `jump_ratio` (1) times what its
    speed allows plus `jump_margin`; `restart_after` consistent ones in a row are a new place.
    The ego's station moves per call at most `back` backwards, and forwards at most `margin` plus
    `reach_ratio` (1) times the distance the ego moved, never more than `reach`. Samples further
    behind than `memory` are forgotten, and never more than `capacity` are held. A window holds at
    most `window_samples`. A bridge has a point every `bridge_spacing` and at most `bridge_length`.
    """

    spacing: float = 0.2
    jump_margin: float = 3.0
    jump_ratio: float = 1.5
    restart_after: int = 3
    back: float = 2.0
    margin: float = 2.0
    reach: float = 10.0
    reach_ratio: float = 1.5
    memory: float = 100.0
    capacity: int = 20_000
    window_samples: int = 40
    bridge_spacing: float = 1.0
    bridge_length: float = 150.0


class Sample(NamedTuple):
    """One received fix: instant (ns), world position (m), yaw (rad), speed (m/s)."""

    measured_at: int
    east: float
    north: float
    yaw: float
    speed: float


class Window(NamedTuple):
    """Samples around the ego in order of travel, arrays of one length.

    `station` (m) is arc length from the ego's projection, negative behind it; `received` is False
    for bridge points.
    """

    east: Floats
    north: Floats
    station: Floats
    received: NDArray[np.bool_]


class Trace:
    """The samples of one source. Counts: `repeated`, `rejected` (jumps), `late`, `restarts`."""

    def __init__(self, settings: TraceSettings | None = None) -> None:
        self.settings = settings or TraceSettings()
        self.newest: Sample | None = None
        self.repeated = 0
        self.rejected = 0
        self.late = 0
        self.restarts = 0
        self._suspects: list[Sample] = []
        self._clear()

    def _clear(self) -> None:
        self._at: list[int] = []
        self._east: list[float] = []
        self._north: list[float] = []
        self._station: list[float] = []
        self._forgotten = 0
        self._forgotten_at = BRIDGE_AT
        self._bridge_from: tuple[float, float] | None = None
        self._here: float | None = None
        self._located = (0.0, 0.0)
        self._moved = True

    def __len__(self) -> int:
        """Points held, bridge included."""
        return len(self._at)

    @property
    def newest_at(self) -> int | None:
        """Instant (ns) of the newest sample taken as true, None before the first."""
        return None if self.newest is None else self.newest.measured_at

    def add(self, measured_at: int, east: float, north: float, yaw: float, speed: float) -> None:
        """Take one fix of the source (ns, m, m, rad, m/s) to its place in the order of travel."""
        sample = Sample(measured_at, east, north, yaw, speed)
        if not (isfinite(east) and isfinite(north) and isfinite(yaw) and isfinite(speed)):
            self.rejected += 1
        elif self.newest is None:
            self.newest = sample
            self._append(sample)
        elif measured_at <= self.newest.measured_at:
            self._insert(sample)
        elif not self._plausible(self.newest, sample):
            self._suspect(sample)
        else:
            self._suspects.clear()
            self.newest = sample
            if hypot(east - self._east[-1], north - self._north[-1]) < self.settings.spacing:
                self.repeated += 1
            else:
                self._append(sample)

    def _plausible(self, one: Sample, other: Sample) -> bool:
        """Whether a car could have been at both."""
        span = abs(other.measured_at - one.measured_at) * 1e-9
        reach = self.settings.jump_ratio * max(abs(one.speed), abs(other.speed)) * span
        distance = hypot(other.east - one.east, other.north - one.north)
        return distance <= reach + self.settings.jump_margin

    def _suspect(self, sample: Sample) -> None:
        """Set a jump aside; several that agree with one another are where the source now is."""
        self.rejected += 1
        if self._suspects and not self._plausible(self._suspects[-1], sample):
            self._suspects.clear()
        self._suspects.append(sample)
        if len(self._suspects) < self.settings.restart_after:
            return
        agreed, self._suspects = sorted(self._suspects), []
        self._clear()
        self.newest = None
        self.restarts += 1
        self.rejected -= len(agreed)
        for one in agreed:
            self.add(*one)

    def _append(self, sample: Sample) -> None:
        station = 0.0
        if self._at:
            step = hypot(sample.east - self._east[-1], sample.north - self._north[-1])
            station = self._station[-1] + step
        self._at.append(sample.measured_at)
        self._east.append(sample.east)
        self._north.append(sample.north)
        self._station.append(station)
        self._moved = True
        if len(self._at) > self.settings.capacity:
            self._forget(FORGET_CHUNK)

    def _insert(self, sample: Sample) -> None:
        """Put a late sample at its place, if that place is still held and it fits there."""
        self.late += 1
        place = bisect_left(self._at, sample.measured_at)
        if sample.measured_at <= self._forgotten_at:
            return
        if place < len(self._at) and self._at[place] == sample.measured_at:
            self.repeated += 1
            return
        neighbours = [k for k in (place - 1, place) if 0 <= k < len(self._at) and self._at[k] >= 0]
        for k in neighbours:
            beside = Sample(self._at[k], self._east[k], self._north[k], sample.yaw, sample.speed)
            if not self._plausible(beside, sample):
                self.rejected += 1
                return
            if hypot(beside.east - sample.east, beside.north - sample.north) < (
                self.settings.spacing
            ):
                self.repeated += 1
                return
        if self._bridge_from is not None and self._at[place - 1] == BRIDGE_AT:
            start = self._bridge_from
            self._drop_first(place)
            self._put(0, sample)
            self._lay_bridge(*start)
        else:
            self._put(place, sample)

    def _put(self, place: int, sample: Sample) -> None:
        """Insert before index `place` and move the stations behind it (and the ego's) along."""
        self._at.insert(place, sample.measured_at)
        self._east.insert(place, sample.east)
        self._north.insert(place, sample.north)
        before = self._station[place] if place < len(self._station) else self._station[-1]
        self._station.insert(place, before)
        self._restation(place)
        if self._here is not None and self._here > before and place + 1 < len(self._station):
            self._here += self._station[place + 1] - before
        self._moved = True

    def _restation(self, first: int) -> None:
        """Recompute the stations from index `first` on."""
        for k in range(first, len(self._station)):
            if k == 0:
                self._station[0] = 0.0
                continue
            step = hypot(self._east[k] - self._east[k - 1], self._north[k] - self._north[k - 1])
            self._station[k] = self._station[k - 1] + step

    def bridge(self, east: float, north: float) -> None:
        """Join the ego's place to the first sample by a straight line, if that lies ahead of it.

        A convoy forms up on a straight lead-in, and what a source drove before it was first heard
        is unknown: points on the straight line let the fit interpolate, where a few noisy samples
        15 to 60 m ahead would be extrapolated backwards. Does nothing once a bridge is laid, once
        the ego is on the trace, or before a sample is held.
        """
        if not self._at or self._bridge_from or self._forgotten or self.newest is None:
            return
        ahead_east, ahead_north = self._east[0] - east, self._north[0] - north
        along = ahead_east * cos(self.newest.yaw) + ahead_north * sin(self.newest.yaw)
        length = hypot(ahead_east, ahead_north)
        if along > self.settings.bridge_spacing and length <= self.settings.bridge_length:
            self._lay_bridge(east, north)

    def _lay_bridge(self, east: float, north: float) -> None:
        first_east, first_north = self._east[0], self._north[0]
        length = hypot(first_east - east, first_north - north)
        count = max(1, ceil(length / self.settings.bridge_spacing))
        shares = [k / count for k in range(count)]
        self._at[:0] = [BRIDGE_AT] * count
        self._east[:0] = [east + share * (first_east - east) for share in shares]
        self._north[:0] = [north + share * (first_north - north) for share in shares]
        self._station[:0] = [0.0] * count
        self._restation(0)
        self._bridge_from = (east, north)
        self._here = None
        self._moved = True

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Cut out the samples from `behind` to `ahead` (m of travel) of the ego at (east, north).

        Thinned evenly to at most `window_samples`; which ones are left out does not change while
        the ego moves, so that thinning does not shake the fit.
        """
        self._locate(east, north)
        here = self._here or 0.0
        first = bisect_left(self._station, here - behind)
        last = bisect_right(self._station, here + ahead)
        stride = max(1, -(-(last - first) // self.settings.window_samples))
        first += -(first + self._forgotten) % stride
        chosen = slice(first, last, stride)
        return Window(
            np.array(self._east[chosen], dtype=np.float64),
            np.array(self._north[chosen], dtype=np.float64),
            np.array(self._station[chosen], dtype=np.float64) - here,
            np.array(self._at[chosen], dtype=np.int64) != BRIDGE_AT,
        )

    def gap(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego at (east, north) to the source's newest place.

        None before anything was heard. How far the source went since is for the caller to add.
        """
        if self.newest is None:
            return None
        self._locate(east, north)
        beyond = (self.newest.east - self._east[-1]) * cos(self.newest.yaw) + (
            self.newest.north - self._north[-1]
        ) * sin(self.newest.yaw)
        return self._station[-1] + beyond - (self._here or 0.0)

    def _locate(self, east: float, north: float) -> None:
        """Move the ego's station to the nearest place within reach of where it was."""
        moved = hypot(east - self._located[0], north - self._located[1])
        if self.newest is None or not (moved or self._moved):
            return
        self._located, self._moved = (east, north), False
        if len(self._at) == 1:
            self._here = (east - self._east[0]) * cos(self.newest.yaw) + (
                north - self._north[0]
            ) * sin(self.newest.yaw)
            return
        low, high = -inf, inf
        if self._here is not None:
            low = self._here - self.settings.back
            reach = self.settings.margin + self.settings.reach_ratio * moved
            high = self._here + min(reach, self.settings.reach)
        self._here = self._nearest(east, north, low, high)
        if self._station[min(FORGET_CHUNK, len(self) - 1)] < self._here - self.settings.memory:
            self._forget(FORGET_CHUNK)

    def _nearest(self, east: float, north: float, low: float, high: float) -> float:
        """Station between `low` and `high` nearest to a place; the end segments extend on."""
        last = len(self._station) - 2
        first = min(max(bisect_right(self._station, low) - 1, 0), last)
        final = min(max(bisect_left(self._station, high) - 1, first), last)
        best, found = inf, 0.0
        for k in range(first, final + 1):
            length = self._station[k + 1] - self._station[k]
            along_east = (self._east[k + 1] - self._east[k]) / length
            along_north = (self._north[k + 1] - self._north[k]) / length
            off_east, off_north = east - self._east[k], north - self._north[k]
            foot = off_east * along_east + off_north * along_north
            if k > 0:
                foot = max(foot, 0.0)
            if k < last:
                foot = min(foot, length)
            foot = min(max(foot, low - self._station[k]), high - self._station[k])
            away = hypot(off_east - foot * along_east, off_north - foot * along_north)
            if away < best:
                best, found = away, self._station[k] + foot
        return found

    def _forget(self, count: int) -> None:
        """Let the first `count` points go."""
        self._forgotten_at = max(self._forgotten_at, self._at[count - 1])
        self._forgotten += count
        self._drop_first(count)

    def _drop_first(self, count: int) -> None:
        del self._at[:count], self._east[:count], self._north[:count], self._station[:count]
