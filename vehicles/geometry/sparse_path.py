"""A path through sparse positions whose chords are within 5 cm of the driven path."""

from collections.abc import Sequence
from math import atan, atan2, ceil, cos, hypot, remainder, sin, tau
from typing import Final, NamedTuple

from vehicles.schedule import MILLISECOND, SECOND

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
