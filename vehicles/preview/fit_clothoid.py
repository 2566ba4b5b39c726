"""Least squares for a curve whose curvature changes evenly: a clothoid.

The arc of `fit_arc` and one more linear unknown, the rate of the curvature: the graph gains a term
that is the clothoid's distance from the arc, to first order in the rate and exact in the curvature.
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
"""Largest rate of curvature (1/m²) that is fitted: at 3 m/s a car of 2.85 m wheelbase then turns
its wheels by half a radian a second.
"""
TURN_MOST: Final = 2.2
"""Turn (rad) from first to last sample above which no clothoid is fitted: the series of its
distance from the arc ends at the sixth power of a quarter of that.
"""


class Clothoid(NamedTuple):
    """Graph of a clothoid, and the column of its rate for `drift`."""

    graph: Graph
    column: Floats


def best_clothoid(data: FitData, line: LineRegression, arc: Graph) -> Clothoid | None:
    """Fit the clothoid of least squares to samples of which the best arc is known.

    One more column in the linear regression of the arc (eq. (5)), its distance from the arc
    measured from the local origin, which the arc passes within the noise of a sample. None where
    the samples do not determine it, or turn too far for it; the rate is limited to `RATE_MOST`.
    """
    if not abs(2.0 * arc.half) * (data.station.item(-1) - data.station.item(0)) < TURN_MOST:
        return None
    column = cubic(data.rows[X], data.rows[SQUARE], arc.half)
    weighted: Floats = column if data.weight is None else data.weight * column
    of_square, of_x, of_y, of_one = np.einsum("ik,k->i", data.rows, weighted).tolist()
    weight, xx, mean_x, spread = line.weight, line.xx, line.mean_x, line.spread
    square_one, square_x = line.square_one, line.square_x
    # The column about 1, x and x² + y², one after the other, each about the ones before.
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
