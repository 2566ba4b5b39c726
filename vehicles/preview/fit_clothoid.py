"""Least squares for a clothoid, a curve with linearly changing curvature.

The arc of `fit_arc` with one more linear unknown, the rate of curvature: its term is the clothoid's
distance from the arc, to first order in the rate and exact in the curvature.
"""

from typing import Final, NamedTuple

import numpy as np

from vehicles.preview.fit_arc import (
    DETERMINED,
    SQUARE,
    FitData,
    Floats,
    Graph,
    LineRegression,
    X,
    cubic,
)

RATE_MOST: Final = 0.06
"""Largest rate of curvature (1/m²) that is fitted: at 3 m/s a car with 2.85 m wheelbase then steers
at 0.5 rad/s.
"""
TURN_MOST: Final = 2.2
"""Largest turn (rad) from first to last sample for which a clothoid is fitted: beyond it the series
of `cubic` is too short.
"""


class Clothoid(NamedTuple):
    """Graph of a clothoid, and its term t for `drift`."""

    graph: Graph
    column: Floats


def best_clothoid(data: FitData, line: LineRegression, arc: Graph) -> Clothoid | None:
    """Fit the clothoid of least squares, given the best `arc`.

    Adds one column to the linear regression of the arc (eq. (5)): the distance of the clothoid from
    the arc, measured from the local origin, which lies on the arc within the noise of a sample.
    None if the samples do not determine it, or turn too far; the rate is clipped to `RATE_MOST`.
    """
    if not abs(2.0 * arc.half) * (data.station.item(-1) - data.station.item(0)) < TURN_MOST:
        return None
    column = cubic(data.rows[X], data.rows[SQUARE], arc.half)
    weighted: Floats = column if data.weight is None else data.weight * column
    of_square, of_x, of_y, of_one = np.einsum("ik,k->i", data.rows, weighted).tolist()
    weight, xx, mean_x, spread = line.weight, line.xx, line.mean_x, line.spread
    square_one, square_x = line.square_one, line.square_x
    # Orthogonalise the column to 1, x and x² + y², in this order.
    by_x = of_x - mean_x * of_one
    by_square = of_square - square_one * of_one / weight - square_x * by_x / xx
    whole = float(np.add.reduce(weighted * column))
    left = whole - of_one * of_one / weight - by_x * by_x / xx - by_square**2 / spread
    if not left > DETERMINED * whole:
        return None
    cross = of_y - arc.offset * of_one - arc.slope * of_x - arc.half * of_square
    rate = min(max(cross / left, -RATE_MOST), RATE_MOST)
    half = arc.half - rate * by_square / spread
    slope = arc.slope - (rate * by_x + (half - arc.half) * square_x) / xx
    offset = line.mean_y - slope * mean_x - half * square_one / weight
    offset -= rate * of_one / weight
    misfit = max(arc.misfit - rate * (2.0 * cross - rate * left), 0.0)
    graph = Graph(offset, slope, half, rate, misfit)
    return Clothoid(graph, column) if graph.square > 0.0 else None
