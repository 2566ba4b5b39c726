"""The half width at which recorded points are smoothed: the first that a car can drive."""

import numpy as np

from scenarios.definition.schema.path_tables import PointsPath
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.geometry.bridges import find_holes, step_lengths
from vehicles.geometry.sampled_path import FloatArray
from vehicles.geometry.smoothing import (
    NoPathError,
    Sections,
    SmoothedPath,
    sections_where,
    smooth_path,
)

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
