"""A path that a vehicle can drive: position, yaw and curvature by arc length.

World frame: east-north, yaw counter-clockwise from east; lateral offset and curvature are positive
to the left. SI units.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import cos, hypot, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vehicles.schedule import MILLISECOND, SECOND

# ---- A point of a path, and the projection of a point on a path


@dataclass(slots=True)
class PathPoint:
    """A point of a path: position (m), yaw of the tangent (rad), signed curvature (1/m).

    (X_0, Y_0), θ_R and 1/R of Section III-B, with positive curvature in left turns. The yaw is
    within [-pi, pi] on an arc spline, and unwrapped on a sampled path.
    """

    east: float
    north: float
    yaw: float
    curvature: float


@dataclass(slots=True)
class Foot:
    """Projection of a point on a path (Section III-B, Figs. 4 and 5).

    Station (m) along the path, lateral offset of the point (m, left of the path positive: e_lat);
    yaw and curvature there as in `PathPoint`.
    """

    station: float
    lateral: float
    yaw: float
    curvature: float


# ---- Sampled path


FloatArray = NDArray[np.float64]

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
    _rows: FloatArray = field(init=False, repr=False)

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
        object.__setattr__(self, "_rows", np.column_stack(arrays))

    @property
    def length(self) -> float:
        """Arc length of the path (Fig. 8) from its first sample to its last (m)."""
        return self.station.item(-1) - self.station.item(0)

    def at(self, station: float) -> PathPoint:
        index = int(self.station.searchsorted(station, "right")) - 1
        index = min(max(index, 0), self.station.size - 2)
        row, following = self._rows[index : index + 2].tolist()
        start, east, north, yaw, curvature = row
        end, next_east, next_north, next_yaw, next_bend = following
        inside = min(max(station, self.station.item(0)), self.station.item(-1))
        step, beyond = end - start, station - inside
        share = (inside - start) / step
        rest = 1.0 - share
        weight = share * share * (3.0 - 2.0 * share)
        leaving, arriving = share * rest * rest * step, -share * share * rest * step
        heading = yaw + share * (next_yaw - yaw)
        east += weight * (next_east - east) + leaving * cos(yaw) + arriving * cos(next_yaw)
        north += weight * (next_north - north) + leaving * sin(yaw) + arriving * sin(next_yaw)
        if beyond == 0.0:
            return PathPoint(east, north, heading, curvature + share * (next_bend - curvature))
        return PathPoint(east + beyond * cos(heading), north + beyond * sin(heading), heading, 0.0)

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
        first = max(int(self.station.searchsorted(low)) - 1, 0)
        last = int(self.station.searchsorted(high, "right")) + 1
        dx, dy = self.east[first:last] - east, self.north[first:last] - north
        nearest = self.station.item(first + int((dx * dx + dy * dy).argmin()))
        station = min(max(nearest, low), high)
        point = self.at(station)
        for _ in range(8):  # each step squares the error; two or three are typical
            forward, left = cos(point.yaw), sin(point.yaw)
            lateral = (north - point.north) * forward - (east - point.east) * left
            along = (east - point.east) * forward + (north - point.north) * left
            # No projection exists beyond the centre of curvature; the bound keeps the step finite.
            along /= max(1.0 - point.curvature * lateral, 0.2)
            target = min(max(station + along, low), high)
            if abs(target - station) < 1e-9:
                break
            station, point = target, self.at(target)
        return Foot(station, lateral, point.yaw, point.curvature)


_Row = tuple[float, float, float, float, float]


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
    chord = distance * (sin(half) / half if abs(half) > 1e-9 else 1.0)
    return (
        station + distance,
        east + chord * cos(yaw + half),
        north + chord * sin(yaw + half),
        yaw + 2.0 * half,
        curvature,
    )


# ---- A path through sparse positions whose chords are within 5 cm of the driven path


CHORD_TOLERANCE: Final = 0.05  # Largest distance (m) of the driven path from a chord
TIME_UNIT: Final = 10 * MILLISECOND  # ns, as in SAE J2735 and EN 302 637-2
DEGREE_UNITS: Final = 1e7  # Its units of latitude and longitude in a degree
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
