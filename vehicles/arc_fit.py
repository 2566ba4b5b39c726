"""Which curve explains a set of samples: line, arc, line→arc or arc→line, as an arc spline.

The paper tells line from arc by the longest prefix within 10 cm of its chord. A 15 m chord of a
300 m arc passes that test, so the choice is made here on all samples at once: each unknown more
has to pay for itself in squared residuals, measured against the noise.
"""

from dataclasses import dataclass
from math import atan2, hypot, inf

import numpy as np
from numpy.typing import NDArray

from vehicles.arc_shapes import Samples, Shape, best_joined, line_and_arc, offsets, refined
from vehicles.arc_spline import ArcSpline, Piece

Floats = NDArray[np.float64]
_sum = np.add.reduce


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Constants of the fit (s, m).

    Samples count up to `preview_time` times the speed ahead, at least `preview_min` (the paper's
    0.8 s), and `behind_time` times the speed behind, at least `behind_min`. `tolerance` is the
    paper's 10 cm: a sample further off is a jump, or is not explained. `position_noise` is what a
    sample is assumed to be off by (RTK, 2 cm); residuals that say less are believed, down to
    `noise_floor`. An arc instead of a line must lower the sum of squared residuals by `evidence`
    times the noise squared, a join by another `join_evidence`. `joins` places are tried for a
    join, none within `piece_min` of the ends. `span_min` is the least travel that has a direction.
    """

    preview_time: float = 0.8
    preview_min: float = 5.0
    behind_time: float = 0.25
    behind_min: float = 4.0
    tolerance: float = 0.10
    position_noise: float = 0.02
    noise_floor: float = 2e-4
    evidence: float = 6.0
    join_evidence: float = 12.0
    joins: int = 10
    piece_min: float = 2.0
    span_min: float = 1.0

    def ahead(self, speed: float) -> float:
        """Preview distance L (m) at `speed` (m/s)."""
        return max(self.preview_min, self.preview_time * speed)

    def behind(self, speed: float) -> float:
        """How far behind the ego samples count (m) at `speed` (m/s)."""
        return max(self.behind_min, self.behind_time * speed)


@dataclass(frozen=True, slots=True)
class Curve:
    """A fitted arc spline in the world and the distance of each sample from it (m)."""

    spline: ArcSpline
    offsets: Floats


def fit_curve(
    east: Floats, north: Floats, station: Floats, weight: Floats, settings: FitSettings
) -> Curve | None:
    """Fit samples in order of `station` (m), world coordinates (m), any positive weights.

    None where the samples do not determine a curve: fewer than three distinct ones, or travel
    shorter than `span_min`.
    """
    if len(station) < 3 or station[-1] - station[0] < settings.span_min:
        return None
    if len(set(station.tolist())) < 3:
        return None
    total = float(_sum(weight))
    weight = weight * (total / float(_sum(weight * weight)))
    total = float(_sum(weight))
    origin_east = float(east[0]) + float(_sum(weight * (east - east[0]))) / total
    origin_north = float(north[0]) + float(_sum(weight * (north - north[0]))) / total
    dx, dy = east - origin_east, north - origin_north
    along = weight * (station - float(_sum(weight * station)) / total)
    ux, uy = float(_sum(along * dx)), float(_sum(along * dy))
    norm = hypot(ux, uy)
    if not 0.0 < norm < inf:
        return None
    ux, uy = ux / norm, uy / norm
    samples = Samples(dx * ux + dy * uy, dy * ux - dx * uy, station, weight)
    shape = _chosen(samples, settings)
    if shape is None:
        return None
    spline = _spline(shape, samples, (origin_east, origin_north, ux, uy))
    return Curve(spline, offsets(shape, samples))


def _chosen(samples: Samples, settings: FitSettings) -> Shape | None:
    """Choose the shape of the fewest unknowns that explains the samples."""
    count = float(_sum(samples.weight))
    line, arc = line_and_arc(samples)
    if arc is None:
        return line
    first, last = float(samples.station[0]), float(samples.station[-1])
    joined = None
    if count > 5.0 and last - first > 3.0 * settings.piece_min:
        low, high = first + settings.piece_min, last - settings.piece_min
        step = (high - low) / (settings.joins - 1)
        joins = low + step * np.arange(settings.joins, dtype=np.float64)
        joined = best_joined(samples, joins)
    best = joined if joined is not None and joined.misfit < arc.misfit else arc
    spare = count - best.freedom
    noise = settings.position_noise**2
    if spare >= 1.0:
        noise = min(max(best.misfit / spare, settings.noise_floor**2), noise)
    shape, score = line, line.misfit
    if arc.misfit + settings.evidence * noise < score:
        shape, score = arc, arc.misfit + settings.evidence * noise
    if joined is not None:
        price = (settings.evidence + settings.join_evidence) * noise
        if joined.misfit + price < score:
            shape = refined(joined, samples)
    return shape


def _spline(shape: Shape, samples: Samples, frame: tuple[float, float, float, float]) -> ArcSpline:
    """Place the shape in the world, from the first sample's projection to the last one's."""
    origin_east, origin_north, ux, uy = frame
    east = origin_east + shape.x * ux - shape.y * uy
    north = origin_north + shape.x * uy + shape.y * ux
    yaw = atan2(uy, ux) + shape.angle
    ends = []
    for curvature, k in ((shape.before, 0), (shape.after, -1)):
        local = Piece(shape.x, shape.y, shape.angle, curvature, 0.0)
        ends.append(local.project(float(samples.x[k]), float(samples.y[k])).station)
    start, end = ends
    if shape.before == shape.after:
        begin = Piece(east, north, yaw, shape.after, 0.0).at(start)
        piece = Piece(begin.east, begin.north, begin.yaw, shape.after, end - start)
        return ArcSpline((piece,))
    begin = Piece(east, north, yaw, shape.before, 0.0).at(start)
    return ArcSpline(
        (
            Piece(begin.east, begin.north, begin.yaw, shape.before, -start),
            Piece(east, north, yaw, shape.after, end),
        )
    )
