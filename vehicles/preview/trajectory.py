"""The composite trajectory: one arc spline through the samples of all sources.

Paper, Section "Target Trajectory Construction", with four departures. The sources are any vehicles
ahead, in the paper lead and predecessor. Tangent and curvature come from the fit, because samples
of two sources can lie side by side. The pieces are chosen on
all samples at once (`curve_fit`). Samples just behind the ego are kept, so that the curve is not
extrapolated to the ego.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.preview.arc_fits import max_abs
from vehicles.preview.curve_fit import Curve, FitSettings, fit_curve
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
_sum = np.add.reduce

JUMP_SHARE: Final = 0.25  # Removing a jump lowers the squared residuals by more than this
MAX_JUMPS: Final = 3  # Number of samples that are removed one by one
MIN_KEPT_SHARE: Final = 0.6  # Share of the samples that must remain
FAR_RATIO: Final = 4.0  # Ratio to the median distance beyond which a sample is far from the curve


def without_jumps(
    east: Floats, north: Floats, station: Floats, offsets: Floats, tolerance: float
) -> NDArray[np.bool_] | None:
    """Select the samples to keep (True) when some `offsets` from a fit exceed `tolerance` (m).

    None if no sample stands out. A jump displaces the curve, so the jumped sample need not be the
    one furthest off. Samples are therefore removed one by one, each time the one without which an
    arc fits the rest best (deletion by leverage, Cook and Weisberg, 1982). If this removes none, a
    whole stretch may have jumped: then all samples far off compared with the median are removed.
    """
    keep = np.ones(len(east), dtype=np.bool_)
    for _ in range(MAX_JUMPS):
        worst = _worst(east[keep], north[keep], station[keep])
        if worst is None:
            break
        keep[np.flatnonzero(keep)[worst]] = False
    if not keep.all():
        return keep
    size = np.abs(offsets)
    near = size <= max(tolerance, FAR_RATIO * float(np.sort(size)[len(size) // 2]))
    kept = int(np.count_nonzero(near))
    return near if max(3.0, MIN_KEPT_SHARE * len(size)) <= kept < len(size) else None


def _worst(east: Floats, north: Floats, station: Floats) -> int | None:
    """Index of the sample without which an arc fits much better; None if there is none.

    Removing sample i from a linear fit lowers the sum of squared residuals by r_i²/(1 − h_i), where
    h_i is its leverage (the diagonal of the hat matrix). The arc is linear in offset, slope and
    curvature along the line of least squares (`fit_arc`).
    """
    along = station - float(_sum(station)) / len(station)
    if len(station) < 5:
        return None
    ux, uy = float(_sum(along * east)), float(_sum(along * north))
    norm = (ux * ux + uy * uy) ** 0.5
    if not 0.0 < norm < np.inf:
        return None
    dx, dy = east - east[0], north - north[0]
    x, y = (dx * ux + dy * uy) / norm, (dy * ux - dx * uy) / norm
    x, y = x - float(_sum(x)) / len(x), y - float(_sum(y)) / len(y)
    square = x * x
    curved = (
        square - float(_sum(square)) / len(x) - float(_sum(square * x)) / float(_sum(square)) * x
    )
    spread = float(_sum(curved * curved))
    if not spread > 0.0:
        return None
    rest = y - float(_sum(x * y)) / float(_sum(square)) * x
    rest = rest - float(_sum(curved * rest)) / spread * curved
    leverage = 1.0 / len(x) + square / float(_sum(square)) + curved * curved / spread
    gain = rest * rest / np.maximum(1.0 - leverage, 1e-9)
    worst = int(gain.argmax())
    return worst if float(gain[worst]) > JUMP_SHARE * float(_sum(rest * rest)) else None


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


class _Merged(NamedTuple):
    """Samples of all sources in order of station; without `weight` each weighs one.

    `columns` are east, north and station (m), shape (3, n).
    """

    columns: Floats
    weight: Floats | None
    source: NDArray[np.int16]

    @property
    def rows(self) -> tuple[Floats, Floats, Floats]:
        return self.columns[0], self.columns[1], self.columns[2]

    def where(self, chosen: NDArray[np.bool_]) -> "_Merged":
        return _Merged(
            self.columns[:, chosen],
            None if self.weight is None else self.weight[chosen],
            self.source[chosen],
        )


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
    curve = None if merged is None else _curve(merged, settings)
    if merged is None or curve is None:
        return None
    most, outliers = max_abs(curve.offsets), 0
    if most > settings.tolerance and settings.trajectory == "fitted":
        keep = without_jumps(*merged.rows, curve.offsets, settings.tolerance)
        kept = None if keep is None or _only_ahead(merged, keep) else merged.where(keep)
        again = None if kept is None else _curve(kept, settings)
        if kept is not None and again is not None:
            outliers = len(merged.source) - len(kept.source)
            merged, curve = kept, again
            most = max_abs(curve.offsets)
    return Fit(curve.spline, *merged.rows, merged.source, curve.rms, most, outliers)


def _only_ahead(merged: _Merged, keep: NDArray[np.bool_]) -> bool:
    """Whether all kept samples lie ahead, so that the curve would be extrapolated to the ego."""
    station = merged.columns[2]
    first: float = station.item(0)
    kept: float = station.item(int(keep.argmax()))
    return first <= 0.0 < kept


def _merge(sources: Sequence[SourceWindow]) -> _Merged | None:
    """Merge the samples of all sources in order of station, weighted as in eq. (5).

    Weights are scaled so that their sum is the number of equally weighted samples with the same
    information. With equal weights all are one. None without samples.
    """
    sampled = [source for source in sources if len(source.window.station)]
    merged = [source for source in sampled if source.weight > 0.0] or sampled
    if not merged:
        return None
    if len(merged) == 1:
        return _alone(merged[0])
    windows = [source.window for source in merged]
    columns = np.concatenate([axis for axes in zip(*windows, strict=True) for axis in axes])
    columns = columns.reshape(3, -1)
    counts = [len(window.station) for window in windows]
    order = columns[2].argsort(kind="stable")
    index = np.repeat(np.arange(len(merged)), counts).take(order)
    source = np.array([one.place for one in merged], dtype=np.int16).take(index)
    weights = [one.weight for one in merged]
    weight = None
    if max(weights) != min(weights):
        total = squares = 0.0
        for share, count in zip(weights, counts, strict=True):
            total += share * count
            squares += share**2 * count
        scale = total / squares
        weight = np.array([scale * share for share in weights]).take(index)
    return _Merged(columns.take(order, 1), weight, source)


def _alone(source: SourceWindow) -> _Merged:
    columns = np.concatenate(source.window).reshape(3, -1)
    return _Merged(columns, None, np.full(columns.shape[1], source.place, dtype=np.int16))


def _curve(merged: _Merged, settings: FitSettings) -> Curve | None:
    if settings.trajectory == "fitted":
        return fit_curve(merged.columns, merged.weight, settings)
    return recipe_curve(*merged.rows, merged.weight, settings)
