"""Points of many composite trajectories at once."""

import numpy as np

from transport.columns import Columns, Integers, ranges
from transport.picture.batch import Floats
from vehicles.geometry.arc_spline import LONGEST_M

SAGITTA_M = 0.01  # Largest distance of a drawn line from its trajectory
MOST_STEPS = 1000.0  # Of a piece, whatever a message contains
_START = ("east_m", "north_m", "yaw_rad", "curvature_per_m", "curvature_rate_per_m2", "length_m")
PIECES = tuple(f"piece_{name}" for name in _START)


def lines_of(trajectories: Columns) -> tuple[Integers, Floats]:
    """Number of points of each trajectory (N), and the joined points (east and north, m).

    Along clothoids (Section III-A), by Simpson's rule between the points. Pieces whose values are
    not finite are left out, as the message may be from any sender.
    """
    pieces = trajectories.lists
    row = np.repeat(np.arange(len(trajectories)), np.diff(pieces[PIECES[0]].offsets))
    east, north, yaw, curvature, rate, length = (pieces[name].values for name in PIECES)
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.clip(length, 0.0, LONGEST_M)
        bend = np.abs(curvature) + np.abs(rate) * length  # largest curvature, 1/m
        known = np.isfinite(east + north + yaw + length * bend)
    row, east, north, yaw = row[known], east[known], north[known], yaw[known]
    curvature, rate, length, bend = curvature[known], rate[known], length[known], bend[known]
    steps = np.clip(np.ceil(length * np.sqrt(bend / (8.0 * SAGITTA_M))), 1.0, MOST_STEPS)
    counts = steps.astype(np.int64) + 1
    piece = np.repeat(np.arange(len(counts)), counts)
    number = ranges(np.zeros(len(counts), np.int64), counts, 1)
    step_m = (length / steps)[piece]
    station = number * step_m

    def direction(at: Floats) -> Floats:
        turned: Floats = np.exp(
            1j * (yaw[piece] + at * (curvature[piece] + 0.5 * rate[piece] * at))
        )
        return turned

    before = station - step_m
    chord = direction(before) + 4.0 * direction(station - 0.5 * step_m) + direction(station)
    chord *= step_m / 6.0
    first = np.cumsum(counts) - counts
    chord[first] = 0.0
    driven = np.cumsum(chord)
    places = np.round((east + 1j * north - driven[first])[piece] + driven, 6)
    return np.bincount(row, counts, len(trajectories)).astype(np.int64), np.column_stack(
        (places.real, places.imag)
    )
