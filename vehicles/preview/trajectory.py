"""The composite trajectory: one arc spline through the samples of lead and predecessor.

Paper, Section "Target Trajectory Construction", with three departures. Tangent and curvature come
from the fit, because a lead and a predecessor sample can lie side by side. The pieces are chosen on
all samples at once (`curve_fit`). Samples just behind the ego are kept, so that the curve is not
extrapolated to the ego.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import ArcSpline
from vehicles.preview.curve_fit import Curve, FitSettings, fit_curve
from vehicles.preview.fit_arc import max_abs
from vehicles.preview.outliers import without_jumps
from vehicles.preview.paper_recipe import recipe_curve
from vehicles.preview.received.samples import Window

Floats = NDArray[np.float64]
LEAD: Final = 0
PREDECESSOR: Final = 1


@dataclass(slots=True)
class Fit:
    """The composite ELC trajectory of Section III-A and its preview data.

    The samples are in order of `station` (m, relative to the ego's projection), their positions in
    the world (m); `source` is 0 for lead, 1 for predecessor. Residuals (m) are those of the samples
    used, `outliers` is the number of jumps left out.
    """

    spline: ArcSpline
    east: Floats
    north: Floats
    station: Floats
    source: NDArray[np.int8]
    residual_rms: float
    residual_max: float
    outliers: int


class _Merged(NamedTuple):
    """Samples of both sources in order of station; without `weight` each weighs one.

    `columns` are east, north and station (m), shape (3, n).
    """

    columns: Floats
    weight: Floats | None
    source: NDArray[np.int8]

    @property
    def rows(self) -> tuple[Floats, Floats, Floats]:
        return self.columns[0], self.columns[1], self.columns[2]

    def where(self, chosen: NDArray[np.bool_]) -> "_Merged":
        return _Merged(
            self.columns[:, chosen],
            None if self.weight is None else self.weight[chosen],
            self.source[chosen],
        )


def fit_composite(
    lead: Window | None,
    predecessor: Window | None,
    *,
    alpha: float,
    settings: FitSettings,
) -> Fit | None:
    """Fit a curve of one piece, or of two with a common tangent (`curve_fit`), to the samples.

    Minimises α Σ e² over the predecessor's plus (1 − α) Σ e² over the lead's samples (J of eq. (5),
    with e the distance from the curve); a source alone gets all the weight. Samples that jumped
    beyond the tolerance are left out, in one pass, but never all samples behind the ego. If
    `settings.trajectory` selects the paper's own rules (`paper_recipe`), none is left out. None if
    the samples support no trajectory.
    """
    merged = _merge(lead, predecessor, alpha)
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


def _merge(lead: Window | None, predecessor: Window | None, alpha: float) -> _Merged | None:
    """Merge the samples of both sources in order of station, weighted as in eq. (5).

    Weights are scaled so that their sum is the number of equally weighted samples with the same
    information. With α = 1/2 all weights are one. None without samples.
    """
    leads = 0 if lead is None else len(lead.station)
    predecessors = 0 if predecessor is None else len(predecessor.station)
    if lead is None or not leads or (alpha >= 1.0 and predecessors):
        return None if predecessor is None else _alone(predecessor, PREDECESSOR)
    if predecessor is None or not predecessors or alpha <= 0.0:
        return _alone(lead, LEAD)
    east, north, station = lead
    next_east, next_north, next_station = predecessor
    joined = np.concatenate((east, next_east, north, next_north, station, next_station))
    columns = joined.reshape(3, -1)
    order = columns[2].argsort(kind="stable")
    source = (order >= leads).view(np.int8)  # False is LEAD, True is PREDECESSOR
    weight = None
    if alpha != 0.5:
        total = (1.0 - alpha) * leads + alpha * predecessors
        scale = total / ((1.0 - alpha) ** 2 * leads + alpha**2 * predecessors)
        weight = np.array((scale * (1.0 - alpha), scale * alpha)).take(source)
    return _Merged(columns.take(order, 1), weight, source)


def _alone(window: Window, source: int) -> _Merged:
    count = len(window.station)
    columns = np.concatenate(window).reshape(3, -1)
    return _Merged(columns, None, np.full(count, source, dtype=np.int8))


def _curve(merged: _Merged, settings: FitSettings) -> Curve | None:
    if settings.trajectory == "fitted":
        return fit_curve(merged.columns, merged.weight, settings)
    return recipe_curve(*merged.rows, merged.weight, settings)
