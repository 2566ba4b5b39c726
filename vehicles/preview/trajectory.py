"""The composite trajectory: one arc spline through the samples of all sources.

Paper, Section "Target Trajectory Construction", with four departures. The sources are any vehicles
ahead, in the paper lead and predecessor. Tangent and curvature come from the fit, because samples
of two sources can lie side by side. The pieces are chosen on
all samples at once (`curve_fit`). Samples just behind the ego are kept, so that the curve is not
extrapolated to the ego.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, inf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_fits import max_abs
from vehicles.geometry.arc_spline import ArcSpline
from vehicles.preview.curve_fit import FitSettings, fit_curve
from vehicles.preview.paper_recipe import recipe_curve
from vehicles.preview.samples import Window

# ---- The samples of one source with their weight, as a fusion receives them


LEAD: Final = 0
PREDECESSOR: Final = 1


class SourceWindow(NamedTuple):
    """Samples of one source around the ego, and its weight in the trajectory.

    `place` is 0 for the lead, else k for the k-th vehicle ahead: 1 for the predecessor. The weights
    of all sources add up to 1.
    """

    place: int
    weight: float
    window: Window


# ---- Outliers among the samples of a fit
#
# The gates check poses one by one before they become samples. They accept a jump of decimetres if
# the receiver's noise explains it, but such a jump would displace the curve.


Floats = NDArray[np.float64]

JUMP_SHARE: Final = 0.25  # Removing a jump lowers the squared residuals by more than this
MAX_JUMPS: Final = 3  # Number of samples that are removed one by one
MIN_KEPT_SHARE: Final = 0.6  # Share of the samples that must remain
FAR_RATIO: Final = 4.0  # Ratio to the median distance beyond which a sample is far from the curve


def without_jumps(columns: Floats, offsets: Floats, tolerance: float) -> NDArray[np.int64] | None:
    """Indices of the samples to keep when some `offsets` from a fit exceed `tolerance` (m).

    `columns` are east, north and station (m), shape (3, n). None if no sample stands out. A jump
    displaces the curve, so the jumped sample need not be the one furthest off. Samples are
    therefore removed one by one, each time the one without which an arc fits the rest best
    (deletion by leverage, Cook and Weisberg, 1982). If this removes none, a whole stretch may have
    jumped: then all samples far off compared with the median are removed.
    """
    kept = np.arange(len(offsets))
    for _ in range(MAX_JUMPS):
        worst = _worst(columns[:, kept])
        if worst is None:
            break
        kept = np.delete(kept, worst)
    if len(kept) == len(offsets):
        size = np.abs(offsets)
        middle = float(np.sort(size)[len(size) // 2])
        kept = np.flatnonzero(size <= max(tolerance, FAR_RATIO * middle))
        if not max(3.0, MIN_KEPT_SHARE * len(size)) <= len(kept) < len(size):
            return None
    return kept


def _worst(columns: Floats) -> int | None:
    """Index of the sample without which an arc fits much better; None if there is none.

    Removing sample i from a linear fit lowers the sum of squared residuals by r_i²/(1 − h_i), where
    h_i is its leverage (the diagonal of the hat matrix). The arc is linear in offset, slope and
    curvature along the line of least squares (`arc_fits`).
    """
    east, north, station = columns
    count, along = len(station), station - np.mean(station)
    ux, uy = float(np.sum(along * east)), float(np.sum(along * north))
    norm = hypot(ux, uy)
    if count < 5 or not 0.0 < norm < inf:
        return None
    dx, dy = east - east[0], north - north[0]
    x, y = (dx * ux + dy * uy) / norm, (dy * ux - dx * uy) / norm
    x, y = x - np.mean(x), y - np.mean(y)
    square, xx = x * x, float(np.sum(x * x))
    curved = square - xx / count - float(np.sum(square * x)) / xx * x
    spread = float(np.sum(curved * curved))
    if not spread > 0.0:
        return None
    rest = y - float(np.sum(x * y)) / xx * x
    rest -= float(np.sum(curved * rest)) / spread * curved
    leverage = 1.0 / count + square / xx + curved * curved / spread
    gain = rest * rest / np.maximum(1.0 - leverage, 1e-9)
    worst = int(gain.argmax())
    return worst if float(gain[worst]) > JUMP_SHARE * float(np.sum(rest * rest)) else None


# ---- Trajectory


@dataclass(slots=True)
class Fit:
    """The composite ELC trajectory of Section III-A and its preview data.

    The samples are in order of `station` (m, relative to the ego's projection), their positions in
    the world (m); `source` is the place of their source (`SourceWindow`). Residuals (m) are those
    of the samples used, `outliers` is the number of jumps left out.
    """

    spline: ArcSpline
    east: Floats
    north: Floats
    station: Floats
    source: NDArray[np.int16]
    residual_rms: float
    residual_max: float
    outliers: int


def fit_composite(sources: Sequence[SourceWindow], settings: FitSettings) -> Fit | None:
    """Fit a curve of one piece, or of two with a common tangent (`curve_fit`), to the samples.

    Minimises Σ w Σ e² over the samples of each source, with its weight w (J of eq. (5): α for the
    predecessor, 1 − α for the lead) and e the distance from the curve. Sources without weight are
    left out unless no other has samples; one alone gets all the weight. Samples that jumped
    beyond the tolerance are left out, in one pass, but never all samples behind the ego. If
    `settings.trajectory` selects the paper's own rules (`paper_recipe`), none is left out. None if
    the samples support no trajectory.
    """
    merged = _merge(sources)
    if merged is None:
        return None
    columns, weight, source = merged
    fit = fit_curve if settings.trajectory == "fitted" else recipe_curve
    curve = fit(columns, weight, settings)
    if curve is None:
        return None
    most, count = max_abs(curve.offsets), len(source)
    if most > settings.tolerance and settings.trajectory == "fitted":
        keep = without_jumps(columns, curve.offsets, settings.tolerance)
        # Without samples behind the ego the curve would be extrapolated to it.
        if keep is not None and not columns[2, 0] <= 0.0 < columns[2, keep[0]]:
            of_kept = None if weight is None else weight[keep]
            again = fit(columns[:, keep], of_kept, settings)
            if again is not None:
                curve, columns, source = again, columns[:, keep], source[keep]
                most = max_abs(curve.offsets)
    east, north, station = columns
    outliers = count - len(source)
    return Fit(curve.spline, east, north, station, source, curve.rms, most, outliers)


def _merge(
    sources: Sequence[SourceWindow],
) -> tuple[Floats, Floats | None, NDArray[np.int16]] | None:
    """Merge the samples of all sources in order of station, weighted as in eq. (5).

    Returns east, north and station (m), shape (3, n), weights, and the place of each source.
    Weights are scaled so that their sum is the number of equally weighted samples with the same
    information. With equal weights they are None. None without samples.
    """
    sampled = [source for source in sources if len(source.window.station)]
    merged = [source for source in sampled if source.weight > 0.0] or sampled
    if not merged:
        return None
    places, weights, windows = zip(*merged, strict=True)
    counts = [len(window.station) for window in windows]
    columns = np.array([np.concatenate(rows) for rows in zip(*windows, strict=True)])
    source = np.repeat(np.array(places, dtype=np.int16), counts)
    if len(merged) == 1:
        return columns, None, source
    order = columns[2].argsort(kind="stable")
    weight = None
    if max(weights) != min(weights):
        total = sum([share * count for share, count in zip(weights, counts, strict=True)])
        squares = sum([share**2 * count for share, count in zip(weights, counts, strict=True)])
        weight = np.repeat([total / squares * share for share in weights], counts).take(order)
    return columns.take(order, 1), weight, source.take(order)
