"""Received samples of one source in their order of travel, and the ego's station among them.

The ego's place on the trace is a station (arc length) that moves only locally from one call to the
next. Whatever lies close by in the plane but far along the trace (the other leg of a hairpin, the
crossing of a figure of eight, an earlier or later lap) is therefore never considered.
"""

from bisect import bisect_left, bisect_right
from itertools import pairwise
from math import atan2, ceil, cos, hypot, inf, isfinite, nan, sin
from typing import Final

import numpy as np

from vehicles.geometry.bridges import UnbridgedError, curve_between
from vehicles.preview.polyline import Polyline, step
from vehicles.preview.samples import Sample, TraceSettings, Window, plausible

__all__ = ["Sample", "Trace", "TraceSettings", "Window"]

BRIDGE_AT: Final = -1
"""Instant of bridge points: before any sample."""
MOST_GUESSED: Final = 500
"""So many points are put into a hole at most."""
MOST_HOLES: Final = 8
"""So many holes are remembered, for late samples that belong there."""
FORGET_CHUNK: Final = 64
"""Samples behind the ego are dropped so many at a time."""


class Trace:
    """The samples of one source, received and stored as in Section III-A.

    `newest` is the newest sample taken as true, `heard` how many were since the start. Counted are
    `repeated` samples (no further along: a stopped source, a message that came twice), `rejected`
    ones (jumps, not finite), `late` ones (out of order, kept or not) and `restarts` at a new place.
    """

    def __init__(self, settings: TraceSettings | None = None) -> None:
        """Start empty."""
        self.settings = settings or TraceSettings()
        self.newest: Sample | None = None
        self.heard = 0
        self.repeated = 0
        self.rejected = 0
        self.late = 0
        self.restarts = 0
        self._suspects: list[Sample] = []
        self._line = Polyline()
        self._first_yaw = 0.0
        self._forgotten_at = BRIDGE_AT
        self._bridged_from: tuple[float, float] | None = None
        self._here: float | None = None
        self._located: tuple[float, float] | None = None
        self._changed = False
        self._holes: list[tuple[Sample, int]] = []

    def __len__(self) -> int:
        """Points held, bridge included."""
        return len(self._line)

    @property
    def newest_at(self) -> int | None:
        """Time stamp (ns; Section III-B) of the newest sample taken as true; None without any."""
        return None if self.newest is None else self.newest.measured_at

    def add(
        self,
        measured_at: int,
        east: float,
        north: float,
        yaw: float,
        speed: float,
        *,
        after_hole: bool = False,
    ) -> None:
        """Take one fix of the source (ns, m, m, rad, m/s) to its place in the order of travel.

        What is received is stored, as in Section III-A; what no car can have driven is refused. If
        it comes `after_hole`, a curve from both sides bridges what was not heard.
        """
        sample = Sample(measured_at, east, north, yaw, speed)
        if not isfinite(east + north + yaw + speed):
            self.rejected += 1
        elif self.newest is None:
            self._start(sample)
        elif measured_at <= self.newest.measured_at:
            self.late += 1
            self._insert(sample)
        elif not plausible(self.newest, sample, self.settings):
            self.rejected += 1
            self._suspect(sample)
        else:
            self._suspects.clear()
            if after_hole:
                self._fill(sample)
            self.newest = sample
            self.heard += 1
            on = step(self._line.point(-1), sample[:4])
            if on < self.settings.spacing:
                self.repeated += 1
            else:
                self._line.append(sample[:4], on)
                self._changed = True
                if len(self._line) > self.settings.capacity:
                    self._forget()

    def pass_over(
        self, measured_at: int, east: float, north: float, yaw: float, speed: float
    ) -> None:
        """Know where the source is by a fix (ns, m, m, rad, m/s), but take its way for no path.

        Preview data of Section III-A are those of a source that keeps to the path.
        """
        sample = Sample(measured_at, east, north, yaw, speed)
        newest = self.newest
        if newest is None or measured_at <= newest.measured_at:
            return
        if plausible(newest, sample, self.settings):
            self.newest = sample

    def _start(self, sample: Sample) -> None:
        """Start anew at `sample`; what was held before is dropped."""
        self.newest = sample
        self.heard = 1
        self._line = Polyline()
        self._line.append(sample[:4], 0.0)
        self._first_yaw = sample.yaw
        self._forgotten_at = BRIDGE_AT
        self._bridged_from = None
        self._here = None
        self._holes.clear()

    def _fill(self, after: Sample) -> None:
        """Put points in front of a sample, by a cubic with the places and headings of both sides.

        They are about a bridge's spacing apart, and their instants lie evenly between.
        """
        before = Sample(*self._line.point(-1), after.speed)
        length = hypot(after.east - before.east, after.north - before.north)
        if length < self.settings.hole:
            return
        spacing = max(self.settings.bridge_spacing, length / MOST_GUESSED)
        try:
            points = curve_between(before[1:4], after[1:4], spacing)
        except UnbridgedError:  # a straight line it is
            return
        count = points.shape[1]
        span = after.measured_at - before.measured_at
        ends = [*points.T.tolist(), [after.east, after.north]]
        for k, ((east, north), (next_east, next_north)) in enumerate(pairwise(ends)):
            yaw = atan2(next_north - north, next_east - east)
            point = (before.measured_at + span * (k + 1) // (count + 1), east, north, yaw)
            last = self._line.point(-1)
            self._line.append(point, hypot(east - last[1], north - last[2]))
        self._holes = [*self._holes[1 - MOST_HOLES :], (before, after.measured_at)]

    def _insert_in_hole(self, sample: Sample) -> None:
        """Put a late sample into a hole: what was guessed there is guessed anew on both sides."""
        hole = next(h for h in self._holes if h[0].measured_at < sample.measured_at < h[1])
        before, end = hole
        line = self._line
        first, last = bisect_right(line.at, before.measured_at), bisect_left(line.at, end)
        if not 0 < first < last < len(line) or not plausible(before, sample, self.settings):
            self.rejected += 1
            return
        self._holes.remove(hole)
        station, tail = line.station[last], line.cut(last)
        line.cut(first)
        self._append(sample)
        self._append(Sample(*tail[0], sample.speed))
        shift = line.station[-1] - station
        for point in tail[1:]:
            line.append(point, step(line.point(-1), point))
        if self._here is not None and self._here > station:
            self._here += shift
        self._changed = True

    def _append(self, sample: Sample) -> None:
        """Add a sample at the end of the line, with what lies between if that is long."""
        self._fill(sample)
        on = step(self._line.point(-1), sample[:4])
        self._line.append(sample[:4], max(on, self.settings.spacing))

    def _suspect(self, sample: Sample) -> None:
        """Keep a jump apart; several consistent ones are the new place of the source."""
        if self._suspects and not plausible(self._suspects[-1], sample, self.settings):
            self._suspects.clear()
        self._suspects.append(sample)
        if len(self._suspects) < self.settings.restart_after:
            return
        agreed, self._suspects = sorted(self._suspects), []
        self.restarts += 1
        self.rejected -= len(agreed)
        self._start(agreed[0])
        for one in agreed[1:]:
            self.add(*one)

    def _insert(self, sample: Sample) -> None:
        """Put a late sample at its place, if that place is still held and it fits there."""
        line = self._line
        if sample.measured_at <= self._forgotten_at:
            return
        if any(hole[0].measured_at < sample.measured_at < hole[1] for hole in self._holes):
            self._insert_in_hole(sample)
            return
        place = bisect_left(line.at, sample.measured_at)
        steps = [0.0, 0.0]
        for side, k in enumerate((place - 1, place)):
            if not 0 <= k < len(line) or line.at[k] == BRIDGE_AT:
                continue
            beside = Sample(*line.point(k), sample.speed)
            if not plausible(beside, sample, self.settings):
                self.rejected += 1
                return
            pair = (sample[:4], line.point(k)) if side else (line.point(k), sample[:4])
            steps[side] = step(*pair)
            if steps[side] < self.settings.spacing:
                self.repeated += 1
                return
        self._changed = True
        self.heard += 1
        if place == 0 or line.at[place - 1] == BRIDGE_AT:
            self._begin_earlier(sample, place)
            return
        before = line.station[place - 1]
        shift = line.insert(place, sample[:4], *steps)
        if self._here is not None and self._here > before:
            self._here += shift

    def _begin_earlier(self, sample: Sample, place: int) -> None:
        """Start the trace with a late sample older than the first received one."""
        start, self._bridged_from = self._bridged_from, None
        self._line.drop(place)
        self._line.prepend([sample[:4]])
        self._first_yaw = sample.yaw
        self._here = None
        if start is not None:
            self.bridge(*start)

    @property
    def joined(self) -> bool:
        """Whether no bridge is wanted any more: it is laid, or the ego is on the trace already."""
        return self._bridged_from is not None or self._forgotten_at != BRIDGE_AT

    def bridge(self, east: float, north: float) -> None:
        """Join the ego's place to the first sample by a straight line, if that lies ahead of it.

        A convoy forms up on a straight lead-in, and what a source drove before its first message
        is unknown: points on the straight line let the fit interpolate, where a few noisy samples
        15 to 60 m ahead would be extrapolated backwards. Does nothing once a bridge is laid, once
        samples behind the ego were forgotten, or before a sample is held.
        """
        line = self._line
        if not line.at or self.joined:
            return
        ahead_east, ahead_north = line.east[0] - east, line.north[0] - north
        along = ahead_east * cos(self._first_yaw) + ahead_north * sin(self._first_yaw)
        length = hypot(ahead_east, ahead_north)
        if along <= self.settings.bridge_spacing or length > self.settings.bridge_length:
            return
        count = ceil(length / self.settings.bridge_spacing)
        shares = [k / count for k in range(count)]
        yaw = atan2(ahead_north, ahead_east)
        line.prepend(
            [
                (BRIDGE_AT, east + share * ahead_east, north + share * ahead_north, yaw)
                for share in shares
            ]
        )
        self._bridged_from = (east, north)
        self._here = None

    def told(self, window: Window) -> Window:
        """What of a window was told by the source (Section III-A), without what bridges a hole."""
        if not self._holes or self._here is None:
            return window
        stations = window.station + self._here
        keep = np.ones(len(stations), dtype=np.bool_)
        for before, end in self._holes:
            low, high = self._station_at(before.measured_at), self._station_at(end)
            keep &= (stations < low + 1e-6) | (stations > high - 1e-6)
        return Window(*(values[keep] for values in window))

    def has_guesses(self, window: Window) -> bool:
        """Whether points of a bridge are in the window cut out last (not in Section III-A)."""
        line, here = self._line, self._here
        if here is None:
            return False
        if line.at[0] == BRIDGE_AT:
            first = bisect_right(line.at, BRIDGE_AT)
            told_from = line.station[first] if first < len(line) else inf
            if window.station.item(0) + here < told_from - 1e-6:
                return True
        return len(self.told(window).station) < len(window.station)

    def instants(self, window: Window) -> list[int]:
        """Instants (ns) of the samples of the window cut out last (time stamps, Section III-B)."""
        here = self._here or 0.0
        places = (bisect_left(self._line.station, here + on - 1e-6) for on in window.station)
        return [self._line.at[min(place, len(self) - 1)] for place in places]

    def _station_at(self, at: int) -> float:
        """Station (m) of the first held point from the instant `at` (ns) on."""
        return self._line.station[min(bisect_left(self._line.at, at), len(self) - 1)]

    def window(self, east: float, north: float, behind: float, ahead: float) -> Window:
        """Cut out the samples from `behind` to `ahead` (m of travel) of the ego at (east, north).

        The preview data of Section III-A, which sorts by distance and keeps none behind.

        If any behind count, the newest of them does, however far behind it lies: a curve that only
        samples ahead determine is extrapolated to the ego, and may pass metres beside it. Where
        fewer than `least_samples` lie there, the next ones on both sides are taken in.
        Thinned to every second, fourth, … sample until at most `window_samples` are left. The same
        ones are left out while the ego moves, so that thinning does not shake the fit.
        """
        here = self._locate(east, north)
        line = self._line
        first = bisect_left(line.station, here - behind)
        if behind > 0.0:
            first = min(first, max(bisect_right(line.station, here) - 1, 0))
        last = bisect_right(line.station, here + ahead)
        if last - first < self.settings.least_samples:
            first, last = self._widened(here, first, last)
        stride = 1 << (max(last - first - 1, 0) // self.settings.window_samples).bit_length()
        first += -(first + line.dropped) % stride
        chosen = slice(first, last, stride)
        return Window(
            np.array(line.east[chosen], dtype=np.float64),
            np.array(line.north[chosen], dtype=np.float64),
            np.array(line.station[chosen], dtype=np.float64) - here,
        )

    def _widened(self, here: float, first: int, last: int) -> tuple[int, int]:
        """Take in the next samples on either side of the ego where too few lie in the window."""
        place = bisect_left(self._line.station, here)
        half = self.settings.least_samples // 2
        last = max(last, min(place + half, len(self._line)))
        return max(min(first, last - self.settings.least_samples, place - half), 0), last

    def gap(self, east: float, north: float) -> float | None:
        """Arc length (m) from the ego at (east, north) to the source's newest place.

        For keeping gaps. None before the first sample. How far the source went since then is for
        the caller to add.
        """
        if self.newest is None:
            return None
        here = self._locate(east, north)
        beyond_east = self.newest.east - self._line.east[-1]
        beyond_north = self.newest.north - self._line.north[-1]
        beyond = beyond_east * cos(self.newest.yaw) + beyond_north * sin(self.newest.yaw)
        return self._line.station[-1] + beyond - here

    def known(self, east: float, north: float) -> float:
        """Path (m) known ahead of the ego at (east, north): negative where it ends behind.

        The metres left of the preview of Section III-A; NaN before the first sample.
        """
        return self._line.station[-1] - self._locate(east, north) if len(self) else nan

    def _locate(self, east: float, north: float) -> float:
        """Move the ego's station to the nearest place within reach of where it was."""
        line, place = self._line, (east, north)
        if self._here is not None and place == self._located and not self._changed:
            return self._here
        before, self._located, self._changed = self._located, place, False
        if len(line) < 2:
            first = place if not line.at else (line.east[0], line.north[0])
            off_east, off_north = east - first[0], north - first[1]
            return off_east * cos(self._first_yaw) + off_north * sin(self._first_yaw)
        low, high = -inf, inf
        if self._here is not None and before is not None:
            moved = hypot(east - before[0], north - before[1])
            reach = self.settings.margin + self.settings.reach_ratio * moved
            low = self._here - self.settings.back
            high = self._here + min(reach, self.settings.reach)
        self._here = line.nearest(east, north, low, high)
        stale = self._here - self.settings.memory
        if len(line) > 2 * FORGET_CHUNK and line.station[FORGET_CHUNK] < stale:
            self._forget()
        return self._here

    def _forget(self) -> None:
        """Drop the oldest points."""
        self._forgotten_at = max(self._forgotten_at, self._line.at[FORGET_CHUNK - 1])
        self._line.drop(FORGET_CHUNK)
