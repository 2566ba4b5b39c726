"""True errors and gaps of the vehicles of a run, at their true poses.

Frames: world coordinates are east and north (m) in the scenario's local plane. The offset from a
path is positive to its left.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.tables import RunTables, common, once
from transport.columns import Columns, Flags, Floats, Integers
from vehicles.car.parameters import VehicleParameters
from vehicles.schedule import SECOND

# ---- Feet of points on a path


STANDSTILL_M = 0.01
"""Poses of the lead closer together than this belong to one place."""
HOLE_NS = SECOND // 10
"""The lead's path is unknown between poses further apart with missing numbers between them."""
CHORDS_BACK = 3
"""Chords behind an expected foot from which it is searched forwards."""
SEARCHES = 6
"""Corrections of an expected foot; each one projects the point on the chord found before."""
ROWS_AT_ONCE = 50
"""Rows of a vehicle (1 s at 50 Hz) after which its expected feet are corrected."""


class PathChords(NamedTuple):
    """Chords of a path; shapes (N): begin, direction (not normalised), length and station (m).

    `hole` marks chords over a part that was not recorded. `from_start`: the first chord is a
    straight that extends backwards.
    """

    east: Floats
    north: Floats
    along_east: Floats
    along_north: Floats
    length: Floats
    station: Floats
    hole: Flags
    from_start: bool


class Feet(NamedTuple):
    """Stations and offsets (m), NaN where the path is unknown; shapes (N)."""

    station: Floats
    lateral: Floats


@once
def lead_path(run: RunTables) -> PathChords | None:
    """Path that the lead drove: the polyline through its poses, and a straight before the first.

    The straight has the direction of the road, or of the first pose if that is not the start. None
    without poses.
    """
    lead = run.table(run.lead, "truth")
    if not len(lead):
        return None
    east, north, at, seq = lead["east_m"], lead["north_m"], lead.at_ns, lead["seq"]
    rows = _without_standstill(east, north)
    from_start = bool(lead["distance_m"][0] == 0.0)
    yaw = run.scenario.route.start_yaw if from_start else lead["yaw_rad"][0]
    along_east = np.concatenate(([np.cos(yaw)], np.diff(east[rows])))
    along_north = np.concatenate(([np.sin(yaw)], np.diff(north[rows])))
    length = np.hypot(along_east, along_north)
    before = np.maximum(rows - 1, 0)
    return PathChords(
        np.concatenate(([east[0] - along_east[0]], east[rows[:-1]])),
        np.concatenate(([north[0] - along_north[0]], north[rows[:-1]])),
        along_east,
        along_north,
        length,
        np.cumsum(np.concatenate(([-1.0, 1.0], length[1:-1])))[: len(rows)],
        (seq[rows] - seq[before] > 1) & (at[rows] - at[before] > HOLE_NS),
        from_start,
    )


def _without_standstill(east: Floats, north: Floats) -> NDArray[np.intp]:
    """Rows of which each is further than STANDSTILL_M from the one before."""
    moves = np.hypot(np.diff(east), np.diff(north)) > STANDSTILL_M
    if moves.all():  # the usual case
        return np.arange(len(east))
    rows, last = [0], (east[0], north[0])
    for row, place in enumerate(zip(east.tolist(), north.tolist(), strict=True)):
        if np.hypot(place[0] - last[0], place[1] - last[1]) > STANDSTILL_M:
            rows.append(row)
            last = place
    return np.array(rows)


def road_path(scenario: Scenario, name: str) -> tuple[PathChords, float]:
    """Road of a vehicle, and the station (m) from which its distance counts."""
    path, start = scenario.road_of(name)
    east, north = np.diff(path.east), np.diff(path.north)
    none = np.zeros(len(east), bool)
    length = np.hypot(east, north)
    station = np.asarray(path.station[:-1])
    return PathChords(
        path.east[:-1], path.north[:-1], east, north, length, station, none, True
    ), start


def feet(path: PathChords, east: Floats, north: Floats, near: Floats) -> Feet:
    """Feet of points (N) on a path, each searched forwards from a little behind station `near` (N).

    So each foot is on its own branch where a path crosses or repeats itself. Both end chords are
    extended.
    """
    return _feet(path, east, north, near)[1]


def _feet(
    path: PathChords, east: Floats, north: Floats, near: Floats
) -> tuple[NDArray[np.intp], Feet]:
    """Chords of feet, and the feet."""
    last = len(path.east) - 1
    station = near.astype(float)
    for _ in range(SEARCHES):
        chord = _chord(path, station)
        station = path.station[chord] + _along(path, chord, east, north)
    chord = np.clip(_chord(path, station) - CHORDS_BACK + 1, 0, last)
    rows = np.arange(len(chord))
    while len(rows):
        is_beyond = _along(path, chord[rows], east[rows], north[rows]) > path.length[chord[rows]]
        rows = rows[is_beyond & (chord[rows] < last)]
        chord[rows] += 1
    outside = (_along(path, chord, east, north) < 0.0) & (chord > 0)
    chord[outside] -= 1  # at the outside of a corner: on the chord before it
    along = _along(path, chord, east, north)
    to_east, to_north = east - path.east[chord], north - path.north[chord]
    across = path.along_east[chord] * to_north - path.along_north[chord] * to_east
    return chord, Feet(path.station[chord] + along, across / path.length[chord])


def _chord(path: PathChords, station: Floats) -> NDArray[np.intp]:
    found = np.searchsorted(path.station, station, side="right") - 1
    return np.clip(found, 0, len(path.east) - 1)


def _along(path: PathChords, chord: NDArray[np.intp], east: Floats, north: Floats) -> Floats:
    """Distance (m) of points along their chords."""
    to_east, to_north = east - path.east[chord], north - path.north[chord]
    product = to_east * path.along_east[chord] + to_north * path.along_north[chord]
    along: Floats = product / path.length[chord]
    return along


def known_feet(path: PathChords, east: Floats, north: Floats, near: Floats) -> Feet:
    """Feet on the lead's path; NaN beyond its end, at its holes, and before an unknown start.

    Points whose station `near` is NaN have none.
    """
    chord, (station, lateral) = _feet(path, east, north, near)
    unknown = (station > path.station[-1] + path.length[-1]) | path.hole[chord]
    unknown |= (station < 0.0) & (not path.from_start)
    unknown |= np.isnan(near)
    return Feet(np.where(unknown, np.nan, station), np.where(unknown, np.nan, lateral))


@once
def path_feet(run: RunTables, follower: str) -> Feet:
    """Feet of a follower on the lead's path, at its true poses; station 0 is the lead's start.

    The expected foot is the distance driven, corrected each second. A replayed vehicle starts where
    its own drive does and has no feet before the lead's start.
    """
    truth, path = run.table(follower, "truth"), lead_path(run)
    unknown = np.full(len(truth), np.nan)
    if path is None or not len(truth):
        return Feet(unknown, unknown)
    east, north, distance = truth["east_m"], truth["north_m"], truth["distance_m"]
    station, lateral = unknown, unknown.copy()
    first = np.zeros(1, np.intp)
    shift = path.station[0] + _along(path, first, east[:1], north[:1])[0] - distance[0]
    for rows in np.split(np.arange(len(truth)), range(ROWS_AT_ONCE, len(truth), ROWS_AT_ONCE)):
        near = distance[rows] + shift
        station[rows], lateral[rows] = known_feet(path, east[rows], north[rows], near)
        known = rows[~np.isnan(station[rows])]
        if len(known):
            shift = station[known[-1]] - distance[known[-1]]
    return _of_vehicle(run, follower, Feet(station, lateral))


def _of_vehicle(run: RunTables, follower: str, found: Feet) -> Feet:
    """Feet of a vehicle or of its corners; a replayed one has none before the lead's start."""
    unknown = (found.station < 0.0) & (follower in run.scenario.replays)
    return Feet(*(np.where(unknown, np.nan, values) for values in found))


def corner_offsets(run: RunTables, follower: str) -> Floats:
    """Offsets (4, N) of the corners of a follower's body from the lead's path; NaN if unknown."""
    truth, path = run.table(follower, "truth"), lead_path(run)
    if path is None:
        return np.full((4, len(truth)), np.nan)
    near = path_feet(run, follower).station
    body = bodies(truth, body_sizes(run)[follower])
    found = [known_feet(path, east, north, near) for east, north in corners(body)]
    return np.array([_of_vehicle(run, follower, one).lateral for one in found])


@once
def cross_track_error(run: RunTables, follower: str) -> Floats:
    """Offset (m) from the lead's path at each true pose, NaN before the lead's start.

    On the stretch before, a follower starts its own motion, and there is no path that the lead
    drove.
    """
    station, lateral = path_feet(run, follower)
    return np.where(station >= 0.0, lateral, np.nan)


@once
def road_error(run: RunTables, name: str) -> Floats:
    """Offset (m) of a vehicle from its road at each true pose."""
    truth = run.table(name, "truth")
    path, start = road_path(run.scenario, name)
    return feet(path, truth["east_m"], truth["north_m"], start + truth["distance_m"]).lateral


# ---- Bodies of cars as oriented rectangles


class BodySize(NamedTuple):
    """Length and width (m) of a body, and the offset of its centre from the centre of mass."""

    length: float
    width: float
    forward: float

    @classmethod
    def of(cls, car: VehicleParameters) -> "BodySize":
        return cls(car.length, car.width, car.body_offset)


def sizes_of(scenario: Scenario) -> dict[str, BodySize]:
    """Bodies of the vehicles of `scenario`, the lead first."""
    return {name: BodySize.of(scenario.vehicle(name).parameters) for name in scenario.vehicle_names}


@once
def body_sizes(run: RunTables) -> dict[str, BodySize]:
    return sizes_of(run.scenario)


class Bodies(NamedTuple):
    """A body at N instants: centre (m), unit vector forwards, velocity (m/s), half sizes (m)."""

    east: Floats
    north: Floats
    along_east: Floats
    along_north: Floats
    speed_east: Floats
    speed_north: Floats
    half_length: float
    half_width: float


def bodies(truth: Columns, size: BodySize) -> Bodies:
    along_east, along_north = np.cos(truth["yaw_rad"]), np.sin(truth["yaw_rad"])
    speed = truth["speed_mps"]
    across = truth["lateral_speed_mps"] + truth["yaw_rate_radps"] * size.forward
    return Bodies(
        truth["east_m"] + size.forward * along_east,
        truth["north_m"] + size.forward * along_north,
        along_east,
        along_north,
        speed * along_east - across * along_north,
        speed * along_north + across * along_east,
        0.5 * size.length,
        0.5 * size.width,
    )


def corners(body: Bodies) -> Iterator[tuple[Floats, Floats]]:
    """Yield the corners (east, north) of bodies, counter-clockwise from front left."""
    for forward, left in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        along, across = forward * body.half_length, left * body.half_width
        yield (
            body.east + along * body.along_east - across * body.along_north,
            body.north + along * body.along_north + across * body.along_east,
        )


def overlap(body: Bodies, other: Bodies) -> Flags:
    """Whether bodies share more than their edges (separating axis theorem).

    Two convex shapes are apart if and only if they are along the normal of one of their sides.
    """
    to_east, to_north = other.east - body.east, other.north - body.north
    cosine = np.abs(body.along_east * other.along_east + body.along_north * other.along_north)
    sine = np.abs(body.along_east * other.along_north - body.along_north * other.along_east)
    over = np.ones(len(to_east), bool)
    for here, there in ((body, other), (other, body)):
        along = np.abs(to_east * here.along_east + to_north * here.along_north)
        across = np.abs(to_north * here.along_east - to_east * here.along_north)
        length, width = there.half_length, there.half_width
        over &= along < here.half_length + length * cosine + width * sine
        over &= across < here.half_width + length * sine + width * cosine
    return over


class Separation(NamedTuple):
    """Distances (m) of bodies, 0 where they overlap, and how fast they shrink (m/s)."""

    distance: Floats
    closing: Floats


def separation(body: Bodies, other: Bodies) -> Separation:
    """Distances of bodies at N instants, and their rates from the velocities without yaw rates.

    The nearest points of two disjoint convex polygons include a corner. Where bodies overlap the
    rate is that along the line of their centres.
    """
    count = len(body.east)
    nearest, east, north = np.full(count, np.inf), np.zeros(count), np.zeros(count)
    for here, there, sign in ((body, other, 1.0), (other, body, -1.0)):
        for corner_east, corner_north in corners(here):
            to_east, to_north = there.east - corner_east, there.north - corner_north
            along = to_east * there.along_east + to_north * there.along_north
            across = to_north * there.along_east - to_east * there.along_north
            along = along - np.clip(along, -there.half_length, there.half_length)
            across = across - np.clip(across, -there.half_width, there.half_width)
            distance = np.hypot(along, across)
            closer = distance < nearest
            nearest = np.where(closer, distance, nearest)
            direction = sign * (along * there.along_east - across * there.along_north)
            east = np.where(closer, direction, east)
            direction = sign * (along * there.along_north + across * there.along_east)
            north = np.where(closer, direction, north)
    over = overlap(body, other)
    nearest[over] = 0.0
    east[over], north[over] = (other.east - body.east)[over], (other.north - body.north)[over]
    length = np.hypot(east, north)
    faster_east = body.speed_east - other.speed_east
    faster_north = body.speed_north - other.speed_north
    rate = faster_east * east + faster_north * north
    return Separation(nearest, rate / np.where(length > 0.0, length, 1.0))


class Gaps(NamedTuple):
    """Distance (m) of two bodies and its rate of closing (m/s) at common instants (ns)."""

    at_ns: Integers
    distance: Floats
    closing: Floats


@once
def gaps(run: RunTables, follower: str) -> Gaps:
    """True gap of a follower to the body ahead, at instants with poses of both."""
    return distances(run, run.ahead(follower), follower)


def distances(run: RunTables, first: str, second: str, within_m: float = np.inf) -> Gaps:
    """Distance of the bodies of two vehicles; infinite if centres are not `within_m` on an axis."""
    one, other = run.table(first, "truth"), run.table(second, "truth")
    at, (rows, others) = common(one.at_ns, other.at_ns)
    near = np.abs(one["east_m"][rows] - other["east_m"][others]) < within_m
    near &= np.abs(one["north_m"][rows] - other["north_m"][others]) < within_m
    sizes = body_sizes(run)
    found = Gaps(at, np.full(len(at), np.inf), np.zeros(len(at)))
    if not near.any():
        return found
    apart = separation(
        bodies(one.of(rows[near]), sizes[first]), bodies(other.of(others[near]), sizes[second])
    )
    found.distance[near], found.closing[near] = apart
    return found


def first_of_periods(at: Integers, period_ns: int) -> Flags:
    """Whether each instant (ns) is the first one in its period."""
    is_first: Flags = np.diff(at // period_ns, prepend=-1) != 0
    return is_first


def at_instants(at: Integers, known_at: Integers, values: Floats) -> Floats:
    """Values at instants `at`; NaN where they are not known."""
    found = np.full(len(at), np.nan)
    _, (rows, known) = common(at, known_at)
    found[rows] = values[known]
    return found
