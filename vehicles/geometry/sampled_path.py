"""A path that a vehicle can drive: position, yaw and curvature by arc length.

World frame: east-north, yaw counter-clockwise from east; lateral offset and curvature are positive
to the left. SI units.
"""

import math
from array import array
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan, atan2, ceil, cos, hypot, remainder, sin, tau
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.schedule import MILLISECOND, SECOND

# ---- A point of a path, and the projection of a point on a path


@dataclass(slots=True)
class PathPoint:
    """A point of a path: position (m), yaw of the tangent (rad), signed curvature (1/m).

    (X_0, Y_0), θ_R and 1/R of Section III-B, with positive curvature in left turns. The yaw is
    wrapped on an arc spline and unwrapped on a sampled path.
    """

    east: float
    north: float
    yaw: float
    curvature: float


@dataclass(slots=True)
class Foot:
    """Projection of a point on a path (Section III-B, Figs. 4 and 5).

    Station (m) along the path, lateral offset of the point (m, left of the path positive: e_lat),
    yaw of the tangent (rad) and signed curvature (1/m) there. The yaw is wrapped on an arc spline
    and unwrapped on a sampled path.
    """

    station: float
    lateral: float
    yaw: float
    curvature: float


# ---- Sampled path


FloatArray = NDArray[np.float64]

COLUMNS: Final = 5  # Values per sample: station, east, north, yaw and curvature
SAMPLING: Final = 0.25  # Maximum distance (m) between samples
WINDOW: Final = 5.0  # Search range (m) around the vehicle's last station
_CORNER: Final = 1e-3  # Distance (m) from the last sample of a segment to the change of curvature


@dataclass(frozen=True, slots=True)
class Segment:
    """A line or arc (Section III-A): length (m), curvature (1/m, left positive)."""

    length: float
    curvature: float


@dataclass(frozen=True, slots=True, eq=False)
class SampledPath:
    """Samples of a path (Section V-C, Fig. 8), each array of shape (n,), n >= 2.

    station (m, strictly increasing), east and north (m), yaw (rad, unwrapped) and curvature (1/m).
    Between samples the position is a cubic (Hermite); yaw and curvature are linear. Beyond both
    ends a path continues straight. The arrays become read-only.
    """

    station: FloatArray
    east: FloatArray
    north: FloatArray
    yaw: FloatArray
    curvature: FloatArray
    _rows: "array[float]" = field(init=False, repr=False)
    _stations: "array[float]" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        arrays = (self.station, self.east, self.north, self.yaw, self.curvature)
        if len({values.shape for values in arrays}) != 1 or self.station.ndim != 1:
            raise ValueError("the arrays of a path must have the same length")
        if self.station.size < 2 or not all(np.isfinite(values).all() for values in arrays):
            raise ValueError("a path needs at least two samples, all finite")
        if not (np.diff(self.station) > 0.0).all():
            raise ValueError("the stations of a path must increase")
        for values in arrays:
            values.setflags(write=False)
        # Single values are read faster than from NumPy's arrays. Tuples take five times the memory,
        # and reference counts would prevent forked vehicles from sharing it.
        rows, stations = array("d"), array("d")
        rows.frombytes(np.column_stack(arrays).data.cast("B"))
        stations.frombytes(np.ascontiguousarray(self.station).data.cast("B"))
        object.__setattr__(self, "_rows", rows)
        object.__setattr__(self, "_stations", stations)

    @property
    def length(self) -> float:
        """Arc length of the path (Fig. 8) from its first sample to its last (m)."""
        return self._stations[-1] - self._stations[0]

    def at(self, station: float) -> PathPoint:
        index = bisect_right(self._stations, station) - 1
        if index < 0:
            return _straight_on(self._rows[:COLUMNS], station)
        if index >= len(self._stations) - 1:
            return _straight_on(self._rows[-COLUMNS:], station)
        first = COLUMNS * index
        return _between(self._rows[first : first + 2 * COLUMNS], station)

    def curvature_at(self, station: float) -> float:
        """Signed curvature (1/m, Section III-A) at `station` (m)."""
        return self.at(station).curvature

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        """Signed curvature (1/m) at `count` stations, `step` (m) apart from `start` (m)."""
        at = start + step * np.arange(count)
        curvatures: list[float] = np.interp(at, self.station, self.curvature, 0.0, 0.0).tolist()
        return curvatures

    def project(
        self, east: float, north: float, near: float | None, window: float = WINDOW
    ) -> Foot:
        """Project (east, north) (m) on the path, within `window` (m) of station `near` (m).

        The projection of Section III-B for any curve, by Newton's method. The window selects the
        branch of a path that crosses or repeats itself. A `near` of None searches the whole path
        and returns the first of equally near points.
        """
        low, high = (-math.inf, math.inf) if near is None else (near - window, near + window)
        station = min(max(self._nearest_sample(east, north, low, high), low), high)
        point = self.at(station)
        for _ in range(8):  # each step squares the error; two or three are typical
            cos, sin = math.cos(point.yaw), math.sin(point.yaw)
            lateral = (north - point.north) * cos - (east - point.east) * sin
            along = (east - point.east) * cos + (north - point.north) * sin
            # No projection exists beyond the centre of curvature; the bound keeps the step finite.
            along /= max(1.0 - point.curvature * lateral, 0.2)
            target = min(max(station + along, low), high)
            if abs(target - station) < 1e-9:
                break
            station, point = target, self.at(target)
        return Foot(station, lateral, point.yaw, point.curvature)

    def _nearest_sample(self, east: float, north: float, low: float, high: float) -> float:
        first = max(0, bisect_left(self._stations, low) - 1)
        last = min(len(self._stations), bisect_right(self._stations, high) + 1)
        if first >= last:  # the window is beyond an end
            return low if first else high
        dx, dy = self.east[first:last] - east, self.north[first:last] - north
        return self._stations[first + int((dx * dx + dy * dy).argmin())]


_Row = tuple[float, float, float, float, float]


def _straight_on(row: "array[float]", station: float) -> PathPoint:
    start, east, north, yaw, curvature = row
    distance = station - start
    return PathPoint(
        east + distance * math.cos(yaw),
        north + distance * math.sin(yaw),
        yaw,
        curvature if distance == 0.0 else 0.0,
    )


def _between(rows: "array[float]", station: float) -> PathPoint:
    """Interpolate between two samples: cubic Hermite position, linear yaw and curvature."""
    start, east, north, yaw, curvature, end, next_east, next_north, next_yaw, next_curvature = rows
    step = end - start
    share = (station - start) / step
    rest = 1.0 - share
    weight = share * share * (3.0 - 2.0 * share)
    leaving, arriving = share * rest * rest * step, -share * share * rest * step
    return PathPoint(
        east
        + weight * (next_east - east)
        + leaving * math.cos(yaw)
        + arriving * math.cos(next_yaw),
        north
        + weight * (next_north - north)
        + leaving * math.sin(yaw)
        + arriving * math.sin(next_yaw),
        yaw + share * (next_yaw - yaw),
        curvature + share * (next_curvature - curvature),
    )


def path_from_segments(
    segments: Sequence[Segment], east: float = 0.0, north: float = 0.0, yaw: float = 0.0
) -> SampledPath:
    """Join straights and arcs, from (east, north) (m) in direction `yaw` (rad).

    An arc spline as in the footnote of Section III-A, with exact samples. A curvature changes
    within the last millimetre of its segment.
    """
    if not segments:
        raise ValueError("a path needs at least one segment")
    start: _Row = (0.0, east, north, yaw, segments[0].curvature)
    rows: list[_Row] = []
    for segment in segments:
        if not (math.isfinite(segment.curvature) and 2 * _CORNER < segment.length < math.inf):
            raise ValueError(f"invalid segment of a path: {segment}")
        count = math.ceil(segment.length / SAMPLING)
        distances = [segment.length * index / count for index in range(count)]
        distances.append(segment.length - _CORNER)  # the end belongs to the next segment
        rows += (_along(start, segment.curvature, distance) for distance in distances)
        start = _along(start, segment.curvature, segment.length)
    rows.append(start)
    return SampledPath(*(np.array(column) for column in zip(*rows, strict=True)))


def _along(start: _Row, curvature: float, distance: float) -> _Row:
    """Sample `distance` (m) along the arc of `curvature` (1/m) from `start`."""
    station, east, north, yaw, _ = start
    half = 0.5 * curvature * distance
    chord = distance * (math.sin(half) / half if abs(half) > 1e-9 else 1.0)
    return (
        station + distance,
        east + chord * math.cos(yaw + half),
        north + chord * math.sin(yaw + half),
        yaw + 2.0 * half,
        curvature,
    )


# ---- A path through sparse positions whose chords are within 5 cm of the driven path


CHORD_TOLERANCE: Final = 0.05  # Largest distance (m) of the driven path from a chord
TIME_UNIT: Final = 10 * MILLISECOND  # ns, as in SAE J2735 and EN 302 637-2
DEGREE_UNITS: Final = 1e7  # Its units of latitude and longitude in a degree
NEIGHBOUR_SHARE: Final = 0.3
"""A neighbour nearer than this share of a chord does not determine its direction: its noise would
turn a long chord."""
STEEPEST: Final = 0.5  # Largest slope of a curve against its chord
HARDEST_BRAKING: Final = 12.0  # Largest acceleration (m/s²) of a car along the road
REACH_RATIO: Final = 1.5
REACH_MARGIN: Final = 3.0
"""A car covers at most this ratio times speed times duration, plus this margin (m)."""

Place = tuple[int, float, float]  # Instant (ns) and position (m, m)
PlacedPose = tuple[int, float, float, float]  # Instant (ns), position (m, m) and yaw (rad)

HistoryDeltas = tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]
"""Differences of latitude, longitude (1e-7 deg) and age (10 ms) of a path history, as sent."""
NO_HISTORY: Final[HistoryDeltas] = ((), (), ())


def drivable(distance: float, span: int, speed: float) -> bool:
    """Whether a car at `speed` (m/s) can have covered `distance` (m) in `span` (ns)."""
    return distance <= REACH_RATIO * speed * (span / SECOND) + REACH_MARGIN


def distance_from_segment(start: Place, end: Place, east: float, north: float) -> float:
    """Distance (m) of (east, north) from the straight segment between two places."""
    along_east, along_north = end[1] - start[1], end[2] - start[2]
    off_east, off_north = east - start[1], north - start[2]
    square = along_east * along_east + along_north * along_north
    share = (off_east * along_east + off_north * along_north) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return hypot(off_east - share * along_east, off_north - share * along_north)


class ReceivedCurve(NamedTuple):
    """Points of a received path between two poses, without both ends.

    `covers` states whether it begins at the first pose; otherwise it begins later. `places` is the
    number of received positions on it.
    """

    points: list[PlacedPose]
    covers: bool
    places: int


def received_curve(
    history: Sequence[Place], before: Place, after: Place, spacing: float, tolerance: float
) -> ReceivedCurve:
    """Curve along the `history` of the pose `after`, oldest position first, from `before` on.

    Nothing is received if `before` lies further than `tolerance` (m) off the history.
    """
    older = [place for place in history if place[0] <= before[0] + TIME_UNIT]
    inside = [place for place in history[len(older) :] if place[0] < after[0] - TIME_UNIT]
    places = [*inside, after]
    if not older:
        points = curve_through(places, 0, len(inside), spacing)
        return ReceivedCurve(points, covers=False, places=len(inside))
    if not distance_from_segment(older[-1], places[0], before[1], before[2]) <= tolerance:
        return ReceivedCurve([], covers=False, places=0)
    places = [*older, before, *places]
    points = curve_through(places, len(older), len(places) - 1, spacing)
    return ReceivedCurve(points[1:], covers=True, places=len(inside))


def has_passed(point: PlacedPose, east: float, north: float, yaw: float, aside: float) -> bool:
    """Whether a vehicle up to `aside` (m) off a path is at or ahead of a `point` of it."""
    _, point_east, point_north, course = point
    forward, left = cos(course), sin(course)
    off_east, off_north = east - point_east, north - point_north
    offset = off_north * forward - off_east * left
    is_ahead = off_east * forward + off_north * left >= 0.0
    return is_ahead and abs(offset) <= aside and cos(yaw - course) > 0.5


def curve_through(
    places: Sequence[Place], first: int, last: int, spacing: float
) -> list[PlacedPose]:
    """Points about `spacing` (m) apart along a curve from `places[first]` to `places[last]`.

    The curve consists of a cubic (Hermite) per chord. Its directions at the ends are those of the
    circles through three places; they are limited so that the cubic stays within `CHORD_TOLERANCE`
    of its chord. Places before `first` are neighbours only. The point at `first` is included, the
    one at `last` is not. Instants are interpolated along the chord.
    """
    points: list[PlacedPose] = []
    for k in range(first, last):
        at, east, north = places[k]
        next_at, next_east, next_north = places[k + 1]
        chord_east, chord_north = next_east - east, next_north - north
        chord = hypot(chord_east, chord_north)
        if chord == 0.0:
            continue
        course = atan2(chord_north, chord_east)
        leaving, arriving = _slopes(places, k, chord, course)
        count = ceil(chord / spacing)
        for step in range(count):
            u = step / count
            rest = 1.0 - u
            aside = leaving * u * rest * rest - arriving * u * u * rest
            slope = leaving * rest * (1.0 - 3.0 * u) + arriving * u * (3.0 * u - 2.0)
            points.append(
                (
                    at + (next_at - at) * step // count,
                    east + u * chord_east - aside * chord_north,
                    north + u * chord_north + aside * chord_east,
                    course + atan(slope),
                )
            )
    return points


def _slopes(places: Sequence[Place], k: int, chord: float, course: float) -> tuple[float, float]:
    """Slopes against the chord from place `k`, at its begin and at its end."""
    before = _neighbour(places, k, -1, chord)
    after = _neighbour(places, k + 1, 1, chord)
    leaving = arriving = None
    if before is not None:
        _, east, north = places[k]
        turn = remainder(course - atan2(north - before[2], east - before[1]), tau)
        length = hypot(north - before[2], east - before[1])
        leaving = -turn * chord / (chord + length)
    if after is not None:
        _, east, north = places[k + 1]
        turn = remainder(atan2(after[2] - north, after[1] - east) - course, tau)
        length = hypot(after[2] - north, after[1] - east)
        arriving = turn * chord / (chord + length)
    if leaving is None:
        leaving = 0.0 if arriving is None else -arriving
    if arriving is None:
        arriving = -leaving
    most = min(4.0 * CHORD_TOLERANCE / chord, STEEPEST)
    return min(max(leaving, -most), most), min(max(arriving, -most), most)


def _neighbour(places: Sequence[Place], k: int, towards: int, chord: float) -> Place | None:
    """Nearest place from `k` on in one direction that determines a direction."""
    _, east, north = places[k]
    least = NEIGHBOUR_SHARE * chord
    k += towards
    while 0 <= k < len(places):
        place = places[k]
        if hypot(place[1] - east, place[2] - north) >= least:
            return place
        k += towards
    return None
