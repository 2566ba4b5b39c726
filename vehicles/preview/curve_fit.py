"""The curve that explains a set of samples: line, arc, clothoid, two joined pieces, or an average.

The paper distinguishes line and arc by the longest prefix within 10 cm of its chord. A 15 m chord
of a 300 m arc passes that test, so here the shape is chosen on all samples at once: each further
unknown must reduce the squared residuals by a price in units of the noise. Curves that explain the
samples about equally well are averaged by their evidence (Akaike weights: K. P. Burnham, D. R.
Anderson, "Model selection and multimodel inference", 2002, Section 2.9). The curve thus moves
continuously from one shape to another; a choice would make the command jump.
"""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, replace
from math import atan2, cos, exp, hypot, inf, log, sin, sqrt
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_spline import (
    ArcSpline,
    Piece,
    PlanePose,
    along_arc,
    near_arc,
    on_clothoid,
)
from vehicles.geometry.geodesy import wrap_angle
from vehicles.preview.arc_fits import (
    ONE,
    BestJoin,
    FitData,
    Graph,
    JoinSearch,
    LineRegression,
    LocalCurve,
    X,
    Y,
    average_graphs,
    best_arc,
    best_clothoid,
    best_join,
    best_line,
    drift,
    line_regression,
    offsets,
    sum_products,
)

# ---- Averaging two curves of the local frame, and placing a curve in the world


Frame = tuple[float, float, float, float]  # Origin (m, m) and unit vector of the x axis


def place_in_world(curve: LocalCurve, data: FitData, frame: Frame) -> ArcSpline:
    """Arc spline of Section III-A in the world, from the first to the last sample's projection."""
    origin_east, origin_north, ux, uy = frame
    join = (
        origin_east + curve.x * ux - curve.y * uy,
        origin_north + curve.x * uy + curve.y * ux,
        atan2(uy, ux) + curve.angle,
    )
    rate, rows = curve.rate, data.rows
    origin = curve.x, curve.y, curve.angle
    before, after = curve.before, curve.after
    start = along_arc(origin, before, rows.item(X, 0), rows.item(Y, 0))
    end = along_arc(origin, after, rows.item(X, -1), rows.item(Y, -1))
    east, north, yaw = _pose_at(join, before, rate, start)
    bend = before + rate * start
    if before == after:
        return ArcSpline((Piece(east, north, yaw, bend, end - start, rate),))
    return ArcSpline((Piece(east, north, yaw, bend, -start, rate), Piece(*join, after, end, rate)))


def average_curves(
    smooth: LocalCurve, joined: LocalCurve, share: float, data: FitData
) -> LocalCurve:
    """Average a one-piece and a two-piece curve; `share` is the weight of the second.

    Position and direction are averaged at the sample nearest to the ego, curvatures everywhere, so
    the curve does not jump when another shape explains the samples better.
    """
    nearest = min(int(data.station.searchsorted(0.0)), len(data.station) - 1)
    x, y = data.rows.item(X, nearest), data.rows.item(Y, nearest)
    rest = 1.0 - share
    cut, lateral, angle = _foot(joined, x, y)
    station, smooth_lateral, smooth_angle = _foot(smooth, x, y)
    angle += rest * wrap_angle(smooth_angle - angle)
    lateral = share * lateral + rest * smooth_lateral
    bend = rest * (smooth.after + smooth.rate * (station - cut))
    before, after, rate = (
        share * joined.before + bend,
        share * joined.after + bend,
        rest * smooth.rate,
    )
    here = (x + lateral * sin(angle), y - lateral * cos(angle), wrap_angle(angle))
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


def _pose_at(start: PlanePose, curvature: float, rate: float, station: float) -> PlanePose:
    point = on_clothoid(start, curvature, rate, station)
    return point.east, point.north, point.yaw


# ---- Curve fit


Floats = NDArray[np.float64]
Trajectory = Literal["fitted", "paper", "paper_prefix"]  # See `paper_recipe`
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
FEW_SAMPLES: Final = 4.0  # Up to this weight a bend must explain more
POOR_SCATTER: Final = 2.0
"""Scatter, in tolerances, above which receivers count as poor. Two good receivers a few decimetres
apart scatter by less.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitSettings:
    """Constants of the fit (s, m); Section III-A names the preview time and the tolerance.

    Window: samples up to `preview_time` times the speed ahead (the paper's 0.8 s), at least
    `preview_min`, and up to `behind_time` times the speed behind, at least `behind_min`.

    Noise: `position_noise` is the assumed error of a sample (RTK, 2 cm); smaller residuals lower
    it, down to `noise_floor`. A sample beyond `tolerance` (the paper's 10 cm) is a jump or is not
    explained.

    Choice of shape: relative to a line, an arc must lower the sum of squared residuals by
    `evidence` times the squared noise, a clothoid by `rate_evidence`, a join of line and arc by
    `join_evidence`, a join of two arcs by another `arcs_evidence`; with few samples each needs
    `few_evidence` more. The weight of a curve falls exponentially with its excess over the best
    score divided by twice the `temperature`; below `ignored` times the best weight it is 0.

    Joins: up to `joins` positions are tried; each piece is at least `piece_min` long and
    `piece_ratio` of the whole. The best join is refined in up to `passes` passes. Samples with less
    travel than `span_min` have no direction.

    `trajectory` selects the fit; the paper's own rules use preview time, tolerance and `span_min`.
    """

    preview_time: float = 0.8
    preview_min: float = 5.0
    behind_time: float = 0.35
    behind_min: float = 3.0
    tolerance: float = 0.10
    position_noise: float = 0.02
    noise_floor: float = 2e-4
    evidence: float = 6.0
    rate_evidence: float = 14.0
    join_evidence: float = 22.0
    arcs_evidence: float = 8.0
    few_evidence: float = 14.0
    temperature: float = 2.5
    ignored: float = 0.15
    joins: int = 7
    piece_min: float = 2.0
    piece_ratio: float = 0.15
    passes: int = 6
    span_min: float = 1.0
    trajectory: Trajectory = "fitted"

    def price_of_join(self, freedom: int) -> float:
        """Price, in squared noise, of a join with `freedom` unknowns.

        Akaike's criterion charges 2 per unknown; the free position of a join costs more.
        """
        return self.join_evidence if freedom == 4 else self.join_evidence + self.arcs_evidence

    def with_stated_noise(self) -> "FitSettings":
        """Settings for samples whose residuals do not measure the noise.

        Beyond Section III-A. Points of a bridge lie on a smooth curve, as a few samples may by
        chance. The estimated noise would be below a millimetre, and noise would pass for a shape.
        """
        return replace(self, noise_floor=self.position_noise)

    def cautious(self) -> "FitSettings":
        """Settings for few samples: a bend of Section III-A must explain `few_evidence` more.

        A bend fitted to noise would be followed until further samples arrive.
        """
        return replace(
            self.with_stated_noise(),
            evidence=self.evidence + self.few_evidence,
            rate_evidence=self.rate_evidence + self.few_evidence,
            join_evidence=self.join_evidence + self.few_evidence,
        )

    def line_only(self) -> "FitSettings":
        """Settings for too few samples for a bend of Section III-A."""
        stated = self.with_stated_noise()
        return replace(stated, evidence=inf, rate_evidence=inf, join_evidence=inf)

    @property
    def score_margin(self) -> float:
        """Excess over the best score, in squared noise, at which the Akaike weight is `ignored`."""
        return 2.0 * self.temperature * log(1.0 / self.ignored)

    def ahead(self, speed: float) -> float:
        """Preview distance L_preview (m) at `speed` (m/s), Section III-A, with a floor."""
        return max(self.preview_min, self.preview_time * speed)

    def behind(self, speed: float) -> float:
        """Length (m) of the window behind the ego at `speed` (m/s); 0 in the paper."""
        if self.trajectory != "fitted":
            return 0.0
        return max(self.behind_min, self.behind_time * speed)


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
    travel shorter than `span_min`.
    """
    station = columns[2]
    count = len(station)
    if count < 3 or not station.item(-1) - station.item(0) >= settings.span_min:
        return None
    early, middle, late = count // 4, count // 2, (3 * count) // 4
    origin_east, origin_north = columns.item(0, middle), columns.item(1, middle)
    ux = columns.item(0, late) - columns.item(0, early)
    uy = columns.item(1, late) - columns.item(1, early)
    chord = hypot(ux, uy)
    if not 0.0 < chord < inf:
        return None
    ux, uy = ux / chord, uy / chord
    away = columns[:2] - columns[:2, middle : middle + 1]
    data = sum_products(away, ux, uy, station, weight)
    curve = _averaged_curve(data, settings)
    if curve is None:
        return None
    rest = offsets(curve, data)
    weighted = rest if weight is None else weight * rest
    rms = sqrt(float(np.add.reduce(weighted * rest)) / data.total[ONE][ONE])
    return Curve(place_in_world(curve, data, (origin_east, origin_north, ux, uy)), rest, rms)


def _averaged_curve(data: FitData, settings: FitSettings) -> LocalCurve | None:
    count = data.total[ONE][ONE]
    if count < MIN_WEIGHT_FOR_NOISE:
        settings = settings.with_stated_noise() if count > FEW_SAMPLES else settings.cautious()
    tried = _candidates(data, settings)
    if tried is None:
        return None
    graphs, joined, noise = tried
    scores = _scores(graphs, noise, settings)
    if joined is not None:
        scores.append(joined.misfit + settings.price_of_join(joined.freedom) * noise)
    least, fade, ignored = min(scores), -0.5 / (settings.temperature * noise), settings.ignored
    weights = [max(exp(fade * (score - least)) - ignored, 0.0) for score in scores]
    share = 0.0 if joined is None else weights.pop()
    of_smooth = sum(weights)
    smooth = average_graphs(graphs, weights, of_smooth) if of_smooth > 0.0 else None
    if joined is None or share == 0.0:
        return smooth
    if smooth is None:
        return joined.curve
    return average_curves(smooth, joined.curve, share / (share + of_smooth), data)


def _scores(graphs: list[Graph], noise: float, settings: FitSettings) -> list[float]:
    """Residuals plus price (m²) of line, arc and clothoid; the best has the smallest score."""
    scores = [graphs[0].distance, graphs[1].distance + settings.evidence * noise]
    if len(graphs) > 2:
        scores.append(graphs[2].distance + settings.rate_evidence * noise)
    return scores


def _candidates(
    data: FitData, settings: FitSettings
) -> tuple[list[Graph], BestJoin | None, float] | None:
    """Candidate curves, and the variance of the noise (m²) if the best candidate is right.

    Line and arc; if the samples drift from the arc also the clothoid, and if they drift from the
    clothoid the best curve with a join.
    """
    through = line_regression(data)
    arc = None if through is None else best_arc(data, through)
    if through is None or arc is None:
        return None
    count = through.weight
    graphs, joined = [best_line(through), arc], None
    stated = settings.position_noise**2
    variance = _variance(arc.distance, 3, count, stated)
    noise = _noise(variance, settings.noise_floor**2, stated)
    unlike = VARIANCE_LIMIT * stated
    if variance > unlike or drift(arc, None, data) > DRIFT_LIMIT * sqrt(noise * count):
        clothoid = best_clothoid(data, through, arc)
        if clothoid is not None:
            graphs.append(clothoid.graph)
            variance = _variance(clothoid.graph.distance, 4, count, stated)
            noise = _noise(variance, settings.noise_floor**2, stated)
        if (
            clothoid is None
            or variance > unlike
            or drift(*clothoid, data) > DRIFT_LIMIT * sqrt(noise * count)
        ):
            least = min(_scores(graphs, noise, settings))
            joined = _candidate_join(data, through, settings, noise, least)
        if joined is not None:
            variance = min(variance, _variance(joined.misfit, joined.freedom, count, stated))
            noise = _noise(variance, settings.noise_floor**2, stated)
    if variance > settings.tolerance**2:  # nothing explains the samples
        scatter = _scatter(arc, data)
        noise = scatter if scatter > (POOR_SCATTER * settings.tolerance) ** 2 else noise
    return graphs, joined, noise


def _scatter(arc: Graph, data: FitData) -> float:
    """Variance of the noise (m²) from the differences of neighbours, which hardly depends on shape.

    J. von Neumann, "Distribution of the ratio of the mean square successive difference to the
    variance", Annals of Mathematical Statistics 12(4), 1941.
    """
    away = offsets(average_graphs((arc,), (1.0,), 1.0), data)
    steps = away[1:] - away[:-1]
    return 0.5 * float(np.add.reduce(steps * steps)) / len(steps)


def _variance(misfit: float, freedom: int, count: float, stated: float) -> float:
    """Variance of the samples' offsets (m²) if the curve is right; `stated` for few samples."""
    spare = count - freedom
    return misfit / spare if spare >= 1.0 else stated


def _noise(variance: float, least: float, stated: float) -> float:
    bounded = variance if variance > least else least  # noqa: FURB136 - twice as fast as max
    return bounded if bounded < stated else stated  # noqa: FURB136 - twice as fast as min


def _candidate_join(
    data: FitData, line: LineRegression, settings: FitSettings, noise: float, least: float
) -> BestJoin | None:
    """Best join of one or two arcs, at least three samples away from both ends.

    None if it would have no weight against the best score so far, `least` (m²).
    """
    stations: list[float] = data.station.tolist()
    first, last = stations[0], stations[-1]
    margin = max(settings.piece_min, settings.piece_ratio * (last - first))
    first, last = first + margin, last - margin
    low = max(bisect_left(stations, first), 2)
    high = min(bisect_right(stations, last), len(stations) - 3)
    if high - low < 2:
        return None
    count = min(settings.joins, high - low)
    indices = [low + k * (high - 1 - low) // (count - 1) for k in range(count)]
    return best_join(
        JoinSearch(data, stations, line, (settings.noise_floor**2, noise), settings.arcs_evidence),
        indices=indices,
        bounds=(first, last),
        misfit_limit=least + (settings.score_margin - settings.join_evidence) * noise,
        passes=settings.passes,
    )
