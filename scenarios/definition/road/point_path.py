"""The path through recorded points."""

from contextlib import suppress

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.schema.path_tables import PointsPath, SegmentsPath
from scenarios.definition.traces.drive import (
    PARTS_MAX,
    PATH_KEYS,
    TOUCH,
    bounds,
    listed_parts,
    recorded_times,
)
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.geometry.bridges import distances_along, find_holes, step_lengths
from vehicles.geometry.sampled_path import FloatArray
from vehicles.geometry.smoothing import (
    MIN_POINTS,
    NoPathError,
    Sections,
    SmoothedPath,
    sections_where,
    smooth_path,
)

# ---- Places of points in their file, and their times in the recorded drive


def place_of(table: PointsPath, point: int) -> str:
    """Return the place of a point (from 0) in its file, and its time in the recorded drive."""
    number = table.source_numbers[point] if point < len(table.source_numbers) else point + 1
    at = f" ({recorded_times(table, [point])[0]:.1f} s)" if table.time_s else ""
    return f"{table.source_unit} {number}{at}"


# ---- The half width at which recorded points are smoothed: the first that a car can drive


SPARSE_REACH = 7.0
"""Reach of smoothing over sparse points, in their distances."""

SHARPEST = LINCOLN_MKZ.steering_limit / LINCOLN_MKZ.wheelbase
"""Largest curvature (1/m) that the usual car drives: a road does not depend on the convoy's."""

TIGHTEST, LEAST_RADIUS = 3.0, 0.5
"""Smallest radius (m) that a car turns, and that of its recorded points with much noise."""

MISSED = 2.0
"""Standard deviations of noise by which the radius of a recorded turn may be too small."""


class UndrivableError(NoPathError):
    """Points without a path at any half width: the error of the widest, the fewest sections."""


def road_through(points: FloatArray, table: PointsPath, lead_in: float) -> SmoothedPath:
    """Smooth `points` (2, n) of a table, with a straight of at least `lead_in` m before them.

    Of `smoothing_m` and `narrower_m` the first half width that a car can drive is used. If there is
    none, the one with the largest smallest radius: noise can make a turn too tight. Raises
    UndrivableError, and ValueError if the points do not form a path for another reason.
    """
    steps = step_lengths(points)
    longest = float(np.max(np.delete(steps, find_holes(steps)), initial=0.0))
    best: tuple[float, SmoothedPath] | None = None
    errors, unfit = list[NoPathError](), list[Sections]()
    for half_width in (table.smoothing_m, *table.narrower_m):
        try:
            road = smooth_path(
                points[0],
                points[1],
                half_width,
                closed=table.closed,
                laps=table.laps,
                noise=table.noise_m,
                lead_in=lead_in + max(half_width, SPARSE_REACH * longest),
            )
        except NoPathError as error:
            errors.append(error.with_traceback(None))  # whose frames hold all points
            unfit.append(error.sections)
            continue
        bends = np.abs(road.path.curvature)
        sharpest, allowed = float(np.max(bends)), _sharpest_turn(road.noise)
        if sharpest <= SHARPEST:
            return road
        if half_width < table.smoothing_m and sharpest > allowed:
            unfit.append(sections_where(bends > allowed, road.path.station, road.stations))
        elif best is None or sharpest < best[0]:
            best = sharpest, road
    if best is None:
        raise UndrivableError(str(errors[0]), errors[0].point, min(unfit, key=len)) from errors[0]
    return best[1]


def _sharpest_turn(noise: float) -> float:
    """Curvature (1/m) above which a turn cannot be that of a car whose points have `noise` (m)."""
    return 1.0 / max(TIGHTEST - MISSED * noise, LEAST_RADIUS)


# ---- The parts of a recorded drive that a car can drive forwards


SHORTEST = 30.0
"""Shortest part (m): what is shorter may be driven in reverse, such as in a three-point turn."""

MARGIN = 1.0
"""Distance (m) along the points that is left out on either side of a section without a path."""


def drivable_parts(table: PointsPath, sections: Sections, lead_in: float, keys: str) -> str:
    """List the parts of a drive between `sections` without a path, each confirmed by smoothing.

    Returns "" without any; the names of the keys that select a part begin with `keys`.
    """
    points = np.array((table.east_m, table.north_m))
    along, unit = distances_along(points), "s" if table.time_s else "m"
    axis = recorded_times(table) if table.time_s else table.begin_m + along
    parts = []
    for ends in _between(sections, along):
        begin, end = bounds(*ends, axis)
        first = int(np.searchsorted(axis, begin - TOUCH))
        last = int(np.searchsorted(axis, end + TOUCH, side="right")) - 1
        with suppress(ValueError):
            road_through(points[:, first : last + 1], table, lead_in)
            parts.append((first, last))
    return listed_parts(parts, axis, along, unit, keys) if parts else ""


def _between(sections: Sections, along: FloatArray) -> list[tuple[int, int]]:
    """Return the first and last point of the longest parts between sections and both ends."""
    result, begin = [], 0
    for left, right in (*sections, (along.size, along.size - 1)):
        end = along.size - 1
        if left < along.size:
            end = int(np.searchsorted(along, along[left] - MARGIN, side="right")) - 1
        if end - begin >= MIN_POINTS and along[end] - along[begin] >= SHORTEST:
            result.append((begin, end))
        begin = max(begin, int(np.searchsorted(along, along[right] + MARGIN)))
    return sorted(result, key=lambda ends: along[ends[0]] - along[ends[1]])[:PARTS_MAX]


# ---- Point path


LONGEST = 86_400.0
"""Longest run (s): a day."""

LONGEST_PATH = 1_000_000.0
"""Longest road (m) of all laps, which takes two points per metre."""


def smoothed_points(table: PointsPath, lead_in: float, keys: str = PATH_KEYS) -> SmoothedPath:
    """Smooth points, with a straight of at least `lead_in` m before them; raises SettingError.

    The names of the keys that select a part of the drive begin with `keys`.
    """
    key = f"path ({table.source})" if table.source else "path"
    points = np.array((table.east_m, table.north_m))
    check_length(table, float(np.sum(step_lengths(points))), keys)
    try:
        return road_through(points, table, lead_in)
    except UndrivableError as error:
        where = f"{place_of(table, error.point)}: {error}"
        raise SettingError(key, f"{where}: {_remedy(table, error, lead_in, keys)}") from error
    except ValueError as error:
        raise SettingError(key, str(error)) from error


def _remedy(table: PointsPath, error: UndrivableError, lead_in: float, keys: str) -> str:
    can_cut = table.source and not table.closed
    if can_cut and (parts := drivable_parts(table, error.sections, lead_in, keys)):
        return f"these parts can be driven: {parts}"
    remedy = "end the drive before it, or start after it"
    if keys == PATH_KEYS:
        remedy += ", or lower path.smoothing_m if a car can drive it"
    return remedy


def check_span(key: str, table: PointsPath, keys: str = PATH_KEYS) -> None:
    """Raise SettingError for a drive that is longer than a run can be; `keys` select a part."""
    if not table.time_s:
        return
    times = np.asarray(table.time_s)
    span = float(times[-1]) - float(times[0])
    if span <= LONGEST:
        return
    with np.errstate(over="ignore"):
        steps = np.diff(times)
    longest = int(np.argmax(steps))
    rest = span - float(steps[longest])
    remedy = f"select a part with {keys}from_s and {keys}to_s"
    if rest <= LONGEST and table.pauses == "keep" and keys == PATH_KEYS:
        remedy += ', or leave pauses out with path.pauses = "cut"'
    raise SettingError(
        key,
        f"recorded times span {span:.6g} s, allowed at most {LONGEST:g}: the longest interval is "
        f"{float(steps[longest]):.6g} s after {place_of(table, longest)}: {remedy}",
    )


def check_length(table: SegmentsPath | PointsPath, lap: float, keys: str = PATH_KEYS) -> None:
    """Raise SettingError for a path that takes too much memory; `lap` is its length (m)."""
    if lap * table.laps > LONGEST_PATH:
        key = "path.laps" if table.laps > 1 else "path"
        whole_km, most_km = lap * table.laps / 1000.0, LONGEST_PATH / 1000.0
        remedy = ""
        if table.laps > 1:
            remedy = ": drive fewer laps"
        elif isinstance(table, PointsPath) and table.source:
            unit = "m" if keys == PATH_KEYS else "s"
            remedy = f": select a part with {keys}from_{unit} and {keys}to_{unit}"
        raise SettingError(
            key, f"{whole_km:.6g} km of road, allowed at most {most_km:g} km{remedy}"
        )
