"""Least squares for a curve whose curvature changes evenly: a clothoid (beyond the paper).

The arc of `fit_arc` and one more linear unknown, the rate of the curvature: the graph gains a term
that is the clothoid's way off the arc, to first order in the rate and exact in the curvature.
"""

from typing import NamedTuple

import numpy as np

from vehicles.preview.fit_arc import (
    DETERMINED,
    ONE,
    SQUARE,
    Centred,
    FitData,
    Floats,
    Graph,
    X,
    cubic,
)

RATE_MOST = 0.06
"""Largest rate of curvature (1/m²) that is taken from samples: at 3 m/s a car of 2.85 m wheelbase
then turns its wheels by half a radian a second."""
TURN_MOST = 2.2
"""Samples that turn by more than this (rad) from first to last are not taken for a clothoid: the
series of its way off the arc ends at the sixth power of a quarter of that."""


class Clothoid(NamedTuple):
    """Graph of a clothoid, and the weighted column of its rate for `drift` (beyond the paper)."""

    graph: Graph
    column: Floats


def best_clothoid(data: FitData, line: Centred, arc: Graph) -> Clothoid | None:
    """Fit the clothoid of least squares to samples of which the best arc is known.

    One more column in the linear regression of the arc (eq. (5)), its way off the arc measured from
    the local origin, which the arc passes within the noise of a sample. None where the samples do
    not determine it, or turn too far for it; a rate beyond `RATE_MOST` is taken as that.
    """
    if not abs(2.0 * arc.half) * (data.station.item(-1) - data.station.item(0)) < TURN_MOST:
        return None
    column = cubic(data.rows[X], data.rows[SQUARE], arc.half)
    weighted: Floats = column if data.weight is None else data.weight * column
    of_square, of_x, of_y, of_one = np.einsum("ik,k->i", data.rows, weighted).tolist()
    row = data.total[SQUARE]
    # The column about 1, x and x² + y², one after the other, each about the ones before.
    cross_x = row[X] - line.mean_x * row[ONE]
    spread = row[SQUARE] - row[ONE] * row[ONE] / line.weight - cross_x * cross_x / line.xx
    by_x = of_x - line.mean_x * of_one
    by_square = of_square - row[ONE] * of_one / line.weight - cross_x * by_x / line.xx
    whole = float(np.add.reduce(weighted * column))
    left = whole - of_one * of_one / line.weight - by_x * by_x / line.xx - by_square**2 / spread
    if not left > DETERMINED * whole:
        return None
    cross = of_y - arc.offset * of_one - arc.slope * of_x - arc.half * of_square
    rate = min(max(cross / left, -RATE_MOST), RATE_MOST)
    half = arc.half - rate * by_square / spread
    slope = arc.slope - (rate * by_x + (half - arc.half) * cross_x) / line.xx
    offset = line.mean_y - slope * line.mean_x - half * row[ONE] / line.weight
    offset -= rate * of_one / line.weight
    misfit = max(arc.misfit - rate * (2.0 * cross - rate * left), 0.0)
    graph = Graph(offset, slope, half, rate, misfit, 4)
    return Clothoid(graph, weighted) if graph.square > 0.0 else None
