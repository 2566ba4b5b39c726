"""Choice of the curve that explains a set of samples: line, arc, line→arc or arc→line.

The paper tells line from arc by the longest prefix within 10 cm of its chord. A 15 m chord of a
300 m arc passes that test, so the choice is made here on all samples at once: each unknown more
has to pay for itself in squared residuals, measured against the noise.
"""

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, sin, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import STRAIGHT, ArcSpline, Piece
from vehicles.preview.fit_arc import (
    ONE,
    Centred,
    FitData,
    LocalCurve,
    X,
    Y,
    best_arc,
    best_line,
    centred,
    drift,
    offsets,
    summed,
)
from vehicles.preview.fit_joined import Joined, best_joined, refined

Floats = NDArray[np.float64]
Trajectory = Literal["fitted", "paper", "paper_prefix"]
"""How a trajectory is made: by this module, or by the paper's own rules (`paper_recipe`)."""
STRAYING = 0.5
"""Drift from an arc, in units of noise times the root of the number of samples, below which no join
needs to be looked for. Two in three lines and arcs stay below; of a thousand curves with a join
that would be found one does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Constants of the fit (s, m): Section III-A names the preview time and the tolerance.

    Samples count up to `preview_time` times the speed ahead, at least `preview_min` (the paper's
    0.8 s), and `behind_time` times the speed behind, at least `behind_min`. `tolerance` is the
    paper's 10 cm: a sample further off is a jump, or is not explained. `position_noise` is what a
    sample is assumed to be off by (RTK, 2 cm); smaller residuals lower that, down to
    `noise_floor`. An arc instead of a line must lower the sum of squared residuals by `evidence`
    times the noise squared, a join by another `join_evidence`. Up to `joins` places are tried for
    a join, each piece being at least `piece_min` long and `piece_ratio` of the whole; the best is
    refined in up to `passes`. `span_min` is the least travel that has a direction.

    `trajectory` says who fits; the paper's own rules know preview time, tolerance and `span_min`.
    """

    preview_time: float = 0.8
    preview_min: float = 4.0
    behind_time: float = 0.35
    behind_min: float = 2.5
    tolerance: float = 0.10
    position_noise: float = 0.02
    noise_floor: float = 2e-4
    evidence: float = 6.0
    join_evidence: float = 16.0
    joins: int = 12
    piece_min: float = 2.0
    piece_ratio: float = 0.15
    passes: int = 3
    span_min: float = 1.0
    trajectory: Trajectory = "fitted"

    def ahead(self, speed: float) -> float:
        """Preview distance L_preview (m) at `speed` (m/s), Section III-A, with a floor."""
        return max(self.preview_min, self.preview_time * speed)

    def behind(self, speed: float) -> float:
        """How far behind the ego samples count (m) at `speed` (m/s); in Section III-A none do."""
        if self.trajectory != "fitted":
            return 0.0
        return max(self.behind_min, self.behind_time * speed)


@dataclass(frozen=True, slots=True)
class Curve:
    """An arc spline in the world (Section III-A), the samples' distances from it, their rms (m)."""

    spline: ArcSpline
    offsets: Floats
    rms: float


def fit_curve(
    east: Floats, north: Floats, station: Floats, weight: Floats, settings: FitSettings
) -> Curve | None:
    """Fit samples in order of `station` (m), world coordinates (m), any positive weights.

    The target trajectory of Section III-A, its pieces chosen as the module describes. None where
    the samples do not determine a curve: fewer than three distinct ones, or travel shorter than
    `span_min`.
    """
    count = len(station)
    if count < 3 or not station.item(-1) - station.item(0) >= settings.span_min:
        return None
    early, middle, late = count // 4, count // 2, (3 * count) // 4
    origin_east, origin_north = east.item(middle), north.item(middle)
    ux, uy = east.item(late) - east.item(early), north.item(late) - north.item(early)
    chord = hypot(ux, uy)
    if not 0.0 < chord < inf:
        return None
    ux, uy = ux / chord, uy / chord
    dx, dy = east - origin_east, north - origin_north
    data = summed(dx * ux + dy * uy, dy * ux - dx * uy, station, weight)
    choice = _chosen(data, settings)
    if choice is None:
        return None
    curve, rest = choice
    rms = sqrt(curve.misfit / data.sums.item(ONE, ONE, -1))
    return Curve(_spline(curve, data, (origin_east, origin_north, ux, uy)), rest, rms)


def _chosen(data: FitData, settings: FitSettings) -> tuple[LocalCurve, Floats] | None:
    """Choose the curve of the fewest unknowns that explains the samples; their distances (m)."""
    through = centred(data)
    arc = None if through is None else best_arc(data, through)
    if through is None or arc is None:
        return None
    line, count = best_line(through), through.weight
    joined = None
    if drift(arc, data) > STRAYING * sqrt(_noise(arc, count, settings) * count):
        joined = _joined(data, through, settings)
    best = joined.curve if joined is not None and joined.curve.misfit < arc.misfit else arc
    noise = _noise(best, count, settings)
    curve, score = line, line.misfit
    if arc.misfit + settings.evidence * noise < score:
        curve, score = arc, arc.misfit + settings.evidence * noise
    price = (settings.evidence + settings.join_evidence) * noise
    if joined is not None and joined.curve.misfit + price < score:
        return _improved(joined, data, settings)
    return curve, offsets(curve, data)


def _noise(curve: LocalCurve, count: float, settings: FitSettings) -> float:
    """Variance of the samples' distances (m²), if the curve is right; as assumed, or less."""
    assumed, spare = settings.position_noise**2, count - curve.freedom
    if spare < 1.0:
        return assumed
    return min(max(curve.misfit / spare, settings.noise_floor**2), assumed)


def _join_range(data: FitData, settings: FitSettings) -> tuple[float, float]:
    """Stations (m) between which a join may lie."""
    first, last = data.station.item(0), data.station.item(-1)
    margin = max(settings.piece_min, settings.piece_ratio * (last - first))
    return first + margin, last - margin


def _joined(data: FitData, line: Centred, settings: FitSettings) -> Joined | None:
    """Try joins at samples, at least three samples away from both ends."""
    first, last = _join_range(data, settings)
    low = max(int(data.station.searchsorted(first)), 2)
    high = min(int(data.station.searchsorted(last, "right")), len(data.station) - 3)
    if high - low < 2:
        return None
    stride = -(-(high - low) // settings.joins)
    return best_joined(data, line, slice(low, high, stride))


def _improved(joined: Joined, data: FitData, settings: FitSettings) -> tuple[LocalCurve, Floats]:
    """Refine a joined curve, unless that makes it worse; with the samples' distances (m)."""
    curve = refined(joined, data, settings.passes, _join_range(data, settings))
    rest = offsets(curve, data)
    misfit = float(np.add.reduce(data.weight * rest * rest))
    if misfit > joined.curve.misfit + settings.noise_floor**2:
        return joined.curve, offsets(joined.curve, data)
    return LocalCurve(*curve[:5], misfit, curve.freedom), rest


def _spline(
    curve: LocalCurve, data: FitData, frame: tuple[float, float, float, float]
) -> ArcSpline:
    """Place the curve in the world, from the first sample's projection to the last one's."""
    origin_east, origin_north, ux, uy = frame
    east = origin_east + curve.x * ux - curve.y * uy
    north = origin_north + curve.x * uy + curve.y * ux
    yaw = atan2(uy, ux) + curve.angle
    start = _station(curve, curve.before, data.rows.item(X, 0), data.rows.item(Y, 0))
    end = _station(curve, curve.after, data.rows.item(X, -1), data.rows.item(Y, -1))
    begin = Piece(east, north, yaw, curve.before, 0.0).at(start)
    if curve.before == curve.after:
        return ArcSpline((Piece(begin.east, begin.north, begin.yaw, curve.after, end - start),))
    return ArcSpline(
        (
            Piece(begin.east, begin.north, begin.yaw, curve.before, -start),
            Piece(east, north, yaw, curve.after, end),
        )
    )


def _station(curve: LocalCurve, curvature: float, x: float, y: float) -> float:
    """Arc length (m) from the curve's join to the projection of (x, y) on its piece."""
    ux, uy = cos(curve.angle), sin(curve.angle)
    dx, dy = x - curve.x, y - curve.y
    xi = dx * ux + dy * uy
    if abs(curvature) < STRAIGHT:
        return xi
    return atan2(curvature * xi, 1.0 - curvature * (dy * ux - dx * uy)) / curvature
