"""The composite trajectory: one arc spline through the samples of all sources.

Paper, Section "Target Trajectory Construction", with four departures. The sources are any vehicles
ahead, in the paper lead and predecessor. Tangent and curvature come from the fit, because samples
of two sources can lie side by side. The pieces are chosen on
all samples at once (`curve_fit`). Samples just behind the ego are kept, so that the curve is not
extrapolated to the ego.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.preview.curve_fit import Curve, FitSettings, fit_curve
from vehicles.preview.fit_arc import max_abs
from vehicles.preview.outliers import without_jumps
from vehicles.preview.paper_recipe import recipe_curve
from vehicles.preview.source_window import SourceWindow

Floats = NDArray[np.float64]


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
