"""The curve that explains a set of samples: line, arc, clothoid, two joined pieces, or an average.

The paper distinguishes line and arc by the longest prefix within 10 cm of its chord. A 15 m chord
of a 300 m arc passes that test, so here the shape is chosen on all samples at once: each further
unknown must reduce the squared residuals by a price in units of the noise. Curves that explain the
samples about equally well are averaged by their evidence (Akaike weights: K. P. Burnham, D. R.
Anderson, "Model selection and multimodel inference", 2002, Section 2.9). The curve thus moves
continuously from one shape to another; a choice would make the command jump.
"""

from dataclasses import dataclass, replace
from math import atan2, cos, exp, hypot, inf, log, remainder, sin, sqrt, tau
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_fits import Graph, LocalCurve, Samples, X, Y, average_graphs
from vehicles.geometry.arc_spline import (
    ArcSpline,
    Piece,
    PlanePose,
    near_arc,
    on_clothoid,
)
from vehicles.preview.joined_fit import BestJoin, JoinSearch

Floats = NDArray[np.float64]
Trajectory = Literal["fitted", "paper", "paper_prefix"]  # See `paper_recipe`

PREVIEW_MIN: Final = 5.0  # Shortest window (m) ahead of the ego
BEHIND_TIME: Final = 0.35  # Length of the window behind the ego, as a time (s) at its speed
BEHIND_MIN: Final = 3.0  # Shortest window (m) behind the ego
SPAN_MIN: Final = 1.0  # Samples with less travel (m) have no direction
ARC_PRICE: Final = 6.0
CLOTHOID_PRICE: Final = 14.0
JOIN_PRICE: Final = 22.0
ARCS_PRICE: Final = 8.0
"""Price, in squared noise, by which a shape must lower the sum of squared residuals relative to a
line; that of two arcs relative to a line and an arc. Akaike's criterion charges 2 per unknown; the
free position of a join costs more.
"""
CAUTION: Final = 14.0  # Further price of each shape with few samples
TEMPERATURE: Final = 2.5
IGNORED: Final = 0.15
"""The weight of a curve falls exponentially with its excess over the best score divided by twice
the temperature; below this share of the best weight it is 0.
"""
SCORE_MARGIN: Final = 2.0 * TEMPERATURE * log(1.0 / IGNORED)  # Excess, in squared noise, there
NOISE_FLOOR: Final = 2e-4  # Lowest noise (m) that residuals prove
DRIFT_LIMIT: Final = 0.5
"""Below this drift from an arc or a clothoid no further shape is tried. In units of noise times the
root of the number of samples; half of all lines and arcs stay below.
"""
VARIANCE_LIMIT: Final = 3.0
"""Above this variance from an arc or a clothoid the next shape is tried without the drift test. In
units of the noise variance; with 40 samples noise alone exceeds it once in 1e8 times.
"""
MIN_WEIGHT_FOR_NOISE: Final = 8.0
"""From this total weight on the residuals measure the noise: an arc then leaves five degrees of
freedom.
"""
JUST_BEGUN: Final = 3  # Up to this number of samples beside a bridge make no bend
FEW_SAMPLES: Final = 4.0  # Up to this weight a bend must explain more
POOR_SCATTER: Final = 2.0
"""Scatter, in tolerances, above which receivers count as poor. Two good receivers a few decimetres
apart scatter by less.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Settings of the fit (s, m); Section III-A names the preview time and the tolerance.

    The window has samples up to `preview_time` times the speed ahead (the paper's 0.8 s). A sample
    beyond `tolerance` (the paper's 10 cm) is a jump or is not explained. `position_noise` is the
    assumed error of a sample (RTK, 2 cm); smaller residuals lower it, down to `noise_floor`. Each
    shape except the line costs `caution` more, in squared noise. `trajectory` selects the fit; the
    paper's own rules use preview time and tolerance.
    """

    preview_time: float = 0.8
    tolerance: float = 0.10
    position_noise: float = 0.02
    noise_floor: float = NOISE_FLOOR
    caution: float = 0.0
    trajectory: Trajectory = "fitted"

    def with_stated_noise(self) -> "FitSettings":
        """Settings for samples whose residuals do not measure the noise.

        Beyond Section III-A. Points of a bridge lie on a smooth curve, as a few samples may by
        chance. The estimated noise would be below a millimetre, and noise would pass for a shape.
        """
        return replace(self, noise_floor=self.position_noise)

    def cautious(self) -> "FitSettings":
        """Settings for few samples: a bend of Section III-A must explain more.

        A bend fitted to noise would be followed until further samples arrive.
        """
        return replace(self, noise_floor=self.position_noise, caution=self.caution + CAUTION)

    def beside_bridge(self, count: float) -> "FitSettings":
        """Settings for `count` samples and the points of a bridge (Section III-A).

        The few samples just beyond a bridge make no bend: their offset from its line may be noise
        of the sample at which it ends.
        """
        if count <= JUST_BEGUN:
            return replace(self.cautious(), caution=inf)
        return self.with_stated_noise() if count >= MIN_WEIGHT_FOR_NOISE else self.cautious()

    def ahead(self, speed: float) -> float:
        """Preview distance L_preview (m) at `speed` (m/s), Section III-A, with a floor."""
        return max(PREVIEW_MIN, self.preview_time * speed)

    def behind(self, speed: float) -> float:
        """Length (m) of the window behind the ego at `speed` (m/s); 0 in the paper."""
        return max(BEHIND_MIN, BEHIND_TIME * speed) if self.trajectory == "fitted" else 0.0


@dataclass(slots=True)
class Curve:
    """An arc spline in the world (Section III-A), offsets of the samples and their rms (m)."""

    spline: ArcSpline
    offsets: Floats
    rms: float


def fit_curve(columns: Floats, weight: Floats | None, settings: FitSettings) -> Curve | None:
    """Fit the target trajectory of Section III-A to samples in order of station.

    `columns` are east, north (world) and station (m), shape (3, n); without `weight` each sample
    weighs one. None if the samples do not determine a curve: fewer than three distinct ones, or
    travel shorter than `SPAN_MIN`.
    """
    station = columns[2]
    count = len(station)
    if count < 3 or not station.item(-1) - station.item(0) >= SPAN_MIN:
        return None
    frame = local_frame(columns, count // 2, count // 4, (3 * count) // 4)
    if frame is None:
        return None
    samples = samples_in(frame, columns, weight)
    curve = _averaged_curve(samples, settings)
    return None if curve is None else in_world(curve, samples, frame)


# ---- Placing a curve of the local frame in the world


Frame = tuple[float, float, float, float]  # Origin (m, m) and unit vector of the x axis


def local_frame(columns: Floats, origin: int, start: int, end: int) -> Frame | None:
    """Frame at sample `origin`, with its x axis from `start` to `end`; None if they coincide."""
    ux, uy = (columns[:2, end] - columns[:2, start]).tolist()
    chord = hypot(ux, uy)
    if not 0.0 < chord < inf:
        return None
    return columns.item(0, origin), columns.item(1, origin), ux / chord, uy / chord


def samples_in(frame: Frame, columns: Floats, weight: Floats | None) -> Samples:
    """Samples of `fit_curve` in a local frame."""
    origin_east, origin_north, ux, uy = frame
    away = columns[:2] - np.array([[origin_east], [origin_north]])
    return Samples(away, ux, uy, columns[2], weight)


def in_world(curve: LocalCurve, samples: Samples, frame: Frame) -> Curve:
    """Arc spline of Section III-A in the world, from the first to the last sample's projection."""
    rest = samples.offsets(curve)
    weighted = rest if samples.weight is None else samples.weight * rest
    rms = sqrt(float(np.add.reduce(weighted * rest)) / samples.count)
    origin_east, origin_north, ux, uy = frame
    join = (
        origin_east + curve.x * ux - curve.y * uy,
        origin_north + curve.x * uy + curve.y * ux,
        atan2(uy, ux) + curve.angle,
    )
    rate, before, after = curve.rate, curve.before, curve.after
    origin, rows = (curve.x, curve.y, curve.angle), samples.rows
    start = near_arc(origin, before, rows.item(X, 0), rows.item(Y, 0)).station
    end = near_arc(origin, after, rows.item(X, -1), rows.item(Y, -1)).station
    first, bend = _pose_at(join, before, rate, start), before + rate * start
    if before == after:
        return Curve(ArcSpline((Piece(*first, bend, end - start, rate),)), rest, rms)
    pieces = Piece(*first, bend, -start, rate), Piece(*join, after, end, rate)
    return Curve(ArcSpline(pieces), rest, rms)


def _pose_at(start: PlanePose, curvature: float, rate: float, station: float) -> PlanePose:
    point = on_clothoid(start, curvature, rate, station)
    return point.east, point.north, point.yaw


# ---- Choice and average of shapes


def _averaged_curve(samples: Samples, settings: FitSettings) -> LocalCurve | None:
    count = samples.count
    if count < MIN_WEIGHT_FOR_NOISE:
        settings = settings.with_stated_noise() if count > FEW_SAMPLES else settings.cautious()
    arc = samples.arc()
    if arc is None:
        return None
    graphs, joined, noise = _candidates(samples, arc, settings)
    scores = _scores(graphs, noise, settings)
    if joined is not None:
        price = JOIN_PRICE + settings.caution + (ARCS_PRICE if joined.freedom == 5 else 0.0)
        scores.append(joined.misfit + price * noise)
    least, fade = min(scores), -0.5 / (TEMPERATURE * noise)
    weights = [max(exp(fade * (score - least)) - IGNORED, 0.0) for score in scores]
    share = 0.0 if joined is None else weights.pop()
    of_smooth = sum(weights)
    if joined is None or share == 0.0:
        return average_graphs(graphs, weights)
    if of_smooth == 0.0:
        return joined.curve
    smooth = average_graphs(graphs, weights)
    return average_curves(smooth, joined.curve, share / (share + of_smooth), samples)


def _scores(graphs: list[Graph], noise: float, settings: FitSettings) -> list[float]:
    """Residuals plus price (m²) of line, arc and clothoid; the best has the smallest score."""
    prices = 0.0, ARC_PRICE + settings.caution, CLOTHOID_PRICE + settings.caution
    return [graph.distance + price * noise for graph, price in zip(graphs, prices, strict=False)]


def _candidates(
    samples: Samples, arc: Graph, settings: FitSettings
) -> tuple[list[Graph], BestJoin | None, float]:
    """Candidate curves, and the variance of the noise (m²) if the best candidate is right.

    Line and arc; if the samples drift from the arc also the clothoid, and if they drift from the
    clothoid the best curve with a join.
    """
    graphs, joined, count = [samples.line(), arc], None, samples.count
    least, stated = settings.noise_floor**2, settings.position_noise**2

    def variance_of(misfit: float, freedom: int) -> float:
        """Variance of the offsets (m²) if the curve is right; the stated one for few samples."""
        return misfit / (count - freedom) if count - freedom >= 1.0 else stated

    def is_unlike(graph: Graph) -> bool:
        return variance > VARIANCE_LIMIT * stated or (
            samples.drift(graph) > DRIFT_LIMIT * sqrt(noise * count)
        )

    variance = variance_of(arc.distance, 3)
    noise = min(max(variance, least), stated)
    if is_unlike(arc):
        clothoid = samples.clothoid(arc)
        if clothoid is not None:
            graphs.append(clothoid)
            variance = variance_of(clothoid.distance, 4)
            noise = min(max(variance, least), stated)
        if clothoid is None or is_unlike(clothoid):
            score = min(_scores(graphs, noise, settings))
            limit = score + (SCORE_MARGIN - JOIN_PRICE - settings.caution) * noise
            joined = JoinSearch(samples, (least, noise), ARCS_PRICE).best(limit)
        if joined is not None:
            variance = min(variance, variance_of(joined.misfit, joined.freedom))
            noise = min(max(variance, least), stated)
    if variance > settings.tolerance**2:  # nothing explains the samples
        scatter = _scatter(arc, samples)
        noise = scatter if scatter > (POOR_SCATTER * settings.tolerance) ** 2 else noise
    return graphs, joined, noise


def _scatter(arc: Graph, samples: Samples) -> float:
    """Variance of the noise (m²) from the differences of neighbours, which hardly depends on shape.

    J. von Neumann, "Distribution of the ratio of the mean square successive difference to the
    variance", Annals of Mathematical Statistics 12(4), 1941.
    """
    steps = np.diff(samples.offsets(average_graphs((arc,), (1.0,))))
    return 0.5 * float(np.add.reduce(steps * steps)) / len(steps)


def average_curves(
    smooth: LocalCurve, joined: LocalCurve, share: float, samples: Samples
) -> LocalCurve:
    """Average a one-piece and a two-piece curve; `share` is the weight of the second.

    Position and direction are averaged at the sample nearest to the ego, curvatures everywhere, so
    the curve does not jump when another shape explains the samples better.
    """
    nearest = min(int(samples.station.searchsorted(0.0)), len(samples.station) - 1)
    x, y = samples.rows.item(X, nearest), samples.rows.item(Y, nearest)
    rest = 1.0 - share
    cut, lateral, angle = _foot(joined, x, y)
    station, smooth_lateral, smooth_angle = _foot(smooth, x, y)
    angle += rest * remainder(smooth_angle - angle, tau)
    lateral = share * lateral + rest * smooth_lateral
    bend = rest * (smooth.after + smooth.rate * (station - cut))
    before, after = share * joined.before + bend, share * joined.after + bend
    rate = rest * smooth.rate
    here = (x + lateral * sin(angle), y - lateral * cos(angle), remainder(angle, tau))
    join = _pose_at(here, (before if cut < 0.0 else after) + rate * cut, rate, -cut)
    return LocalCurve(*join, before, after, rate)


def _foot(curve: LocalCurve, x: float, y: float) -> PlanePose:
    """Project (x, y): station (m) from the curve's P, offset (m) and direction (rad).

    On a clothoid by two Newton steps, each to the osculating circle.
    """
    origin = curve.x, curve.y, curve.angle
    foot = near_arc(origin, curve.after, x, y)
    if foot.station < 0.0 and curve.before != curve.after:
        foot = near_arc(origin, curve.before, x, y)
    station = foot.station
    if curve.rate != 0.0:
        there = _pose_at(origin, curve.after, curve.rate, station)
        foot = near_arc(there, curve.after + curve.rate * station, x, y)
        station += foot.station
    return station, foot.lateral, foot.yaw
