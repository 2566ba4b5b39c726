"""The path through recorded points, at the first half width of smoothing that a car can drive."""

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.schema.path_tables import PointsPath, SegmentsPath
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.geometry.bridges import find_holes, step_lengths
from vehicles.geometry.smoothing import NoPathError, SmoothedPath, smooth_path

LONGEST = 86_400.0
"""Longest run (s): a day."""

LONGEST_PATH = 1_000_000.0
"""Longest road (m) of all laps, which takes two points per metre."""

SPARSE_REACH = 7.0
"""Reach of smoothing over sparse points, in their distances."""

SHARPEST = LINCOLN_MKZ.steering_limit / LINCOLN_MKZ.wheelbase
"""Largest curvature (1/m) that the usual car drives: a road does not depend on the convoy's."""

TIGHTEST, LEAST_RADIUS = 3.0, 0.5
"""Smallest radius (m) that a car turns, and that of its recorded points with much noise."""

MISSED = 2.0
"""Standard deviations of noise by which the radius of a recorded turn may be too small."""


def smoothed_points(table: PointsPath, lead_in: float) -> SmoothedPath:
    """Smooth points, with a straight of at least `lead_in` m before them; raises SettingError.

    Of `smoothing_m` and `narrower_m` the first half width that a car can drive is used. If there is
    none, the one with the largest smallest radius: noise can make a turn too tight.
    """
    key = f"path ({table.source})" if table.source else "path"
    steps = step_lengths(np.array((table.east_m, table.north_m)))
    check_length(table, float(np.sum(steps)))
    longest = float(np.max(np.delete(steps, find_holes(steps)), initial=0.0))
    best: tuple[float, SmoothedPath] | None = None
    failed: NoPathError | None = None
    for half_width in (table.smoothing_m, *table.narrower_m):
        before = lead_in + max(half_width, SPARSE_REACH * longest)
        try:
            road = _smoothed(table, half_width, before)
        except NoPathError as error:
            failed = failed or error
            continue
        except ValueError as error:
            raise SettingError(key, str(error)) from error
        sharpest = float(np.max(np.abs(road.path.curvature)))
        if sharpest <= SHARPEST:
            return road
        if half_width < table.smoothing_m and sharpest > _sharpest_turn(road.noise):
            continue
        if best is None or sharpest < best[0]:
            best = sharpest, road
    if best is None:
        raise SettingError(key, _why_none(table, failed)) from failed
    return best[1]


def _sharpest_turn(noise: float) -> float:
    """Curvature (1/m) above which a turn cannot be that of a car whose points have `noise` (m)."""
    return 1.0 / max(TIGHTEST - MISSED * noise, LEAST_RADIUS)


def _smoothed(table: PointsPath, half_width: float, lead_in: float) -> SmoothedPath:
    return smooth_path(
        table.east_m,
        table.north_m,
        half_width,
        closed=table.closed,
        laps=table.laps,
        noise=table.noise_m,
        lead_in=lead_in,
    )


def _why_none(table: PointsPath, error: NoPathError | None) -> str:
    where = f"{place_of(table, error.point)}: {error}" if error else "no path"
    return (
        f"{where}: end the drive before it, or start after it, "
        "or lower path.smoothing_m if a car can drive it"
    )


def place_of(table: PointsPath, point: int) -> str:
    """Return the place of a point (from 0) in its file, and its time."""
    number = table.source_numbers[point] if point < len(table.source_numbers) else point + 1
    at = f" ({table.time_s[point]:.1f} s)" if table.time_s else ""
    return f"{table.source_unit} {number}{at}"


def check_span(key: str, table: PointsPath) -> None:
    """Raise SettingError for a drive that is longer than a run can be."""
    span = max(table.time_s, default=0.0) - min(table.time_s, default=0.0)
    if not span <= LONGEST:
        raise SettingError(key, f"recorded times span {span:.6g} s, allowed at most {LONGEST:g}")


def check_length(table: SegmentsPath | PointsPath, lap: float) -> None:
    """Raise SettingError for a path that takes too much memory; `lap` is its length (m)."""
    if lap * table.laps > LONGEST_PATH:
        key = "path.laps" if table.laps > 1 else "path"
        whole_km, most_km = lap * table.laps / 1000.0, LONGEST_PATH / 1000.0
        raise SettingError(key, f"{whole_km:.6g} km of road, allowed at most {most_km:g} km")
