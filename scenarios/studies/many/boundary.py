"""Posterior of a logistic curve: the share of runs that break a limit over the value of a key.

The share at a value x is

    p(x) = G(G⁻¹(share) ± (x - boundary) / width),

so that the requested share is reached at `boundary`; G is the logistic function. The prior is
uniform in both directions, the boundary (half a range beyond both ends) and the logarithm of the
width. As runs are simulated near the boundary, other S-shaped curves are approximated well there.

Kuss, Jäkel and Wichmann, Bayesian inference for psychometric functions, Journal of Vision 5, 2005.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, floor, isfinite, log, log10
from typing import Literal

import numpy as np

from scenarios.definition.errors import ScenarioError
from scenarios.definition.overrides import OverrideError, parsed, value_at
from scenarios.definition.run_limits import Limit
from scenarios.results.links import CONFIDENCE
from scenarios.studies.engine import Engine
from scenarios.studies.job import Job
from scenarios.studies.many.variant import Variant
from transport.columns import Floats

NODES, WIDTHS = 41, 17
"""Nodes of the grid over the boundary and over the logarithm of the width."""
BEYOND = 0.5
"""Part of the range by which the prior of the boundary exceeds both ends."""
WIDEST = 0.5
"""Largest width, as a part of the range."""
PASSES = 5
"""Evaluations at most; each one confines the grid to the nodes that matter."""
NEGLIGIBLE = 1e-4
"""Marginal probability of a node, relative to the largest, below which the grid may end."""
DIRECTIONS = np.array([1.0, -1.0])
"""The curve rises or falls."""


@dataclass(frozen=True, slots=True)
class ShareCurve:
    """Posterior weights (2, m, w) of both directions, of `boundaries` (m) and `widths` (w).

    `held` and `broken` are the probabilities that the share is below, or above, the requested one
    everywhere in the range.
    """

    share: float
    boundaries: Floats
    widths: Floats
    weights: Floats
    held: float
    broken: float

    def quantile(self, probability: float) -> float:
        weights = self.weights.sum(axis=(0, 2))
        steps = 0.5 * (weights[1:] + weights[:-1])
        cumulative = np.concatenate(([0.0], np.cumsum(steps))) / steps.sum()
        return float(np.interp(probability, cumulative, self.boundaries))

    def shares_at(self, values: Sequence[float]) -> Floats:
        """Mean share of broken runs at the values (n)."""
        log_broken, _ = _log_shares(self.share, np.array(values), self.boundaries, self.widths)
        shares: Floats = np.tensordot(np.exp(log_broken), self.weights, 3)
        return shares

    @property
    def rises(self) -> bool:
        return bool(self.weights[0].sum() >= 0.5)


def fit_curve(
    values: Floats,
    runs: Floats,
    broken: Floats,
    *,
    share: float,
    span: tuple[float, float],
    narrowest: float,
) -> ShareCurve:
    """Fit numbers of runs and of broken runs at values (n); `span` is the range of the search.

    `narrowest` is the smallest width of the prior.
    """
    low, high = span
    extent = high - low
    nodes = low - BEYOND * extent, high + BEYOND * extent
    scales = log(narrowest), log(WIDEST * extent)
    for _ in range(PASSES):
        boundaries = np.linspace(*nodes, NODES)
        widths = np.exp(np.linspace(*scales, WIDTHS))
        log_broken, log_kept = _log_shares(share, values, boundaries, widths)
        likelihood = np.tensordot(broken, log_broken, 1) + np.tensordot(runs - broken, log_kept, 1)
        weights = np.exp(likelihood - likelihood.max())
        weights /= weights.sum()
        narrower = _support(boundaries, weights.sum(axis=(0, 2)))
        scales = _support(np.log(widths), weights.sum(axis=(0, 1)))
        if narrower[1] - narrower[0] > 0.6 * (nodes[1] - nodes[0]):
            break
        nodes = narrower
    above, below = boundaries > high, boundaries < low
    return ShareCurve(
        share=share,
        boundaries=boundaries,
        widths=widths,
        weights=weights,
        held=float(weights[0, above].sum() + weights[1, below].sum()),
        broken=float(weights[0, below].sum() + weights[1, above].sum()),
    )


def _log_shares(
    share: float, values: Floats, boundaries: Floats, widths: Floats
) -> tuple[Floats, Floats]:
    """Logarithms of the shares of broken and of kept runs at values (n), of shape (n, 2, m, w)."""
    distance = (values[:, None, None] - boundaries[:, None]) / widths
    z = log(share / (1.0 - share)) + DIRECTIONS[:, None, None] * distance[:, None]
    return -np.logaddexp(0.0, -z), -np.logaddexp(0.0, z)


def _support(nodes: Floats, weights: Floats) -> tuple[float, float]:
    (matter,) = np.nonzero(weights > NEGLIGIBLE * weights.max())
    first, last = max(matter[0] - 1, 0), min(matter[-1] + 1, len(nodes) - 1)
    return float(nodes[first]), float(nodes[last])


# ---- `convoy bisect`: the query, its runs, and the result


MAX_VALUES = 100_000
FIRST_VALUES, FIRST_RUNS = 9, 2
"""Evenly spaced values that are simulated first, and runs at each of them."""
LEAST_BATCH, GROWTH = 16, 0.25
"""Runs of a later batch: at least 16, and a quarter of those before."""
QUANTILES = (0.025, 0.2, 0.5, 0.8, 0.975)
"""Quantiles of the boundary at which a batch is simulated."""
EVENTS = 20
"""Expected number of broken, and of kept, runs among as many as are simulated at least."""
NARROWEST = 0.005
"""Smallest width of the fitted curve, relative to the precision."""
GROUPS = 8
"""Rows of the table."""
CERTAIN = 0.99
"""Probability from which the limit counts as held, or as broken, everywhere in the range."""
MISFIT = 38.0
"""Deviance of the grouped counts from the curve that occurs once in 100 000 searches (chi²)."""

Finding = Literal["found", "held", "broken", "misfit"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryQuery:
    """Search for the value of `key` from which on a `share` of the runs breaks `limit`.

    The search covers `low` to `high`. It ends when half the width of the 95 % interval is at most
    `precision` (by default a fiftieth of the range), or after `max_runs` runs. Run number n has the
    seed n. `variant` is the run without key and seed.
    """

    variant: Variant
    key: str
    limit: Limit
    low: float = 0.0
    high: float = 1.0
    precision: float | None = None
    share: float = 0.5
    max_runs: int = 1000

    @property
    def half_width(self) -> float:
        return (self.high - self.low) / 50.0 if self.precision is None else self.precision

    @property
    def least_runs(self) -> int:
        """Runs among which `EVENTS` are expected to break the limit, and to keep it."""
        return ceil(EVENTS / min(self.share, 1.0 - self.share) - 1e-9)

    def rounded(self, value: float) -> float:
        """Round a value to a digit that is fine for the precision, within the range."""
        step = 10.0 ** floor(log10(self.half_width / 5.0))
        inside = min(max(round(value / step) * step, self.low), self.high)
        return float(f"{inside:.12g}")

    def at(self, value: float, seed: int) -> Variant:
        overrides = (*self.variant.overrides, f"{self.key}={value:.12g}")
        return replace(self.variant, overrides=overrides, seed=seed)

    def check(self) -> None:
        """Raise ScenarioError for an invalid range, precision, share, key or end value."""
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            wrong = (
                f"--range: given {self.low:g}:{self.high:g}, allowed LOW:HIGH with LOW below HIGH"
            )
            raise ScenarioError([wrong])
        width = self.high - self.low
        if not width / MAX_VALUES <= self.half_width <= 0.25 * width:
            allowed = f"allowed up to a quarter of the range, {0.25 * width:g}"
            raise ScenarioError([f"--precision: given {self.half_width:g}, {allowed}"])
        if not 0.001 <= self.share <= 0.999:
            raise ScenarioError([f"--share: given {self.share:g}, allowed 0.001 to 0.999"])
        if self.max_runs < self.least_runs:
            allowed = f"allowed at least {self.least_runs} for a share of {self.share:g}"
            raise ScenarioError([f"--runs: given {self.max_runs}, {allowed}"])
        try:
            now = value_at(parsed(self.variant.scenario.text), self.key)
        except OverrideError as error:
            raise ScenarioError([f"{self.key}: {error}"]) from error
        if self.key == "seed" or isinstance(now, bool | str | list | dict):
            raise ScenarioError([f"{self.key}: given {now!r}, allowed a key with a number"])
        if isinstance(now, int):
            raise ScenarioError(
                [f"{self.key}: takes whole numbers; use `convoy sweep --vary {self.key}=…`"]
            )
        for value in (self.low, self.high):
            _ = self.at(value, 1).scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class SharePoint:
    """Runs at the values `low` to `high`, and the share of broken runs of the fitted curve."""

    low: float
    high: float
    runs: int
    broken: int
    fitted: float

    @property
    def share(self) -> float:
        return self.broken / self.runs


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryResult:
    """The share of runs that break the limit reaches the requested share at `boundary`.

    `low` and `high` are the ends of its 95 % interval, None beyond the range. The curve `rises` or
    falls. If the limit is `held` or `broken` everywhere in the range, or if the counts do not
    follow an S-shaped curve (`misfit`), all of these are None. `points` are all simulated values.
    `commands` repeat the nearest runs that broke and that kept the limit.
    """

    finding: Finding
    boundary: float | None
    low: float | None
    high: float | None
    rises: bool | None
    runs: int
    points: tuple[SharePoint, ...]
    commands: Mapping[str, str]

    @property
    def half_width(self) -> float | None:
        """Half the width of the interval; None without one of its ends."""
        if self.low is None or self.high is None:
            return None
        return 0.5 * (self.high - self.low)


@dataclass(slots=True)
class _SearchRuns:
    """Outcomes of all runs: whether the limit was broken, by value and seed."""

    query: BoundaryQuery
    engine: Engine
    broke: dict[float, dict[int, bool]] = field(default_factory=dict)
    count: int = 0

    def run(self, values: Iterable[float]) -> None:
        jobs, places = list[Job](), list[tuple[float, int]]()
        for value in sorted(map(self.query.rounded, values)):
            self.count += 1
            variant = self.query.at(value, self.count)
            key, work = f"{value:.12g}/{self.count}", partial(variant.breaks, self.query.limit)
            jobs.append(Job(key=key, work=work, command=variant.command))
            places.append((value, self.count))
        for (value, seed), broke in zip(places, self.engine.results(jobs), strict=True):
            self.broke.setdefault(value, {})[seed] = broke

    def fitted(self) -> ShareCurve:
        query, values = self.query, sorted(self.broke)
        runs = np.array([len(self.broke[value]) for value in values], dtype=float)
        broken = np.array([sum(self.broke[value].values()) for value in values], dtype=float)
        narrowest = NARROWEST * query.half_width
        span = query.low, query.high
        return fit_curve(
            np.array(values), runs, broken, share=query.share, span=span, narrowest=narrowest
        )

    def points(self, curve: ShareCurve) -> tuple[SharePoint, ...]:
        values = sorted(self.broke)
        return tuple(
            SharePoint(
                low=value,
                high=value,
                runs=len(self.broke[value]),
                broken=sum(self.broke[value].values()),
                fitted=float(f"{fitted:.6g}"),
            )
            for value, fitted in zip(values, curve.shares_at(values), strict=True)
        )


def find_boundary(query: BoundaryQuery, engine: Engine) -> BoundaryResult:
    """Run the search; the query must be valid."""
    runs = _SearchRuns(query, engine)
    runs.run(np.repeat(np.linspace(query.low, query.high, FIRST_VALUES), FIRST_RUNS).tolist())
    while True:
        curve = runs.fitted()
        finding = _finding(query, curve, runs)
        if finding is not None:
            return _result(query, curve, runs, finding)
        low, middle, high = (curve.quantile(one) for one in (0.025, 0.5, 0.975))
        engine.progress.stage = (
            f"{query.key} {query.rounded(middle):g} "
            f"({query.rounded(low):g} to {query.rounded(high):g})"
        )
        batch = min(max(LEAST_BATCH, int(GROWTH * runs.count)), query.max_runs - runs.count)
        places = [curve.quantile(one) for one in QUANTILES]
        # The width of the interval falls with the square root of the number of runs.
        needed = runs.count * (0.5 * (high - low) / query.half_width) ** 2
        needed = max(ceil(needed), query.least_runs, runs.count + batch)
        engine.progress.expected = min(needed, query.max_runs)
        runs.run(places[number % len(places)] for number in range(batch))


def _finding(query: BoundaryQuery, curve: ShareCurve, runs: _SearchRuns) -> Finding | None:
    """Return why the search ends, or None."""
    if curve.held > CERTAIN:
        return "held"
    if curve.broken > CERTAIN:
        return "broken"
    if deviance(runs.points(curve)) > MISFIT:
        return "misfit"
    tail = 0.5 - 0.5 * CONFIDENCE
    width = curve.quantile(1.0 - tail) - curve.quantile(tail)
    is_precise = width <= 2.0 * query.half_width and runs.count >= query.least_runs
    return "found" if is_precise or runs.count >= query.max_runs else None


def _result(
    query: BoundaryQuery, curve: ShareCurve, runs: _SearchRuns, finding: Finding
) -> BoundaryResult:
    is_found = finding == "found"
    tail = 0.5 - 0.5 * CONFIDENCE
    low, middle, high = (_digits(curve.quantile(one)) for one in (tail, 0.5, 1.0 - tail))
    return BoundaryResult(
        finding=finding,
        boundary=min(max(middle, query.low), query.high) if is_found else None,
        low=low if is_found and low >= query.low else None,
        high=high if is_found and high <= query.high else None,
        rises=curve.rises if is_found else None,
        runs=runs.count,
        points=runs.points(curve),
        commands=_commands(query, middle, runs),
    )


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


def _commands(query: BoundaryQuery, boundary: float, runs: _SearchRuns) -> dict[str, str]:
    """Commands of the runs nearest to the boundary that broke and that kept the limit."""
    commands = {}
    nearest = sorted(runs.broke, key=lambda value: abs(value - boundary))
    for verdict, wanted in (("breaks", True), ("keeps", False)):
        for value in nearest:
            seed = next((one for one, broke in runs.broke[value].items() if broke == wanted), None)
            if seed is not None:
                commands[f"{verdict} {query.limit} at {value:g}"] = query.at(value, seed).command
                break
    return commands


def grouped(points: Sequence[SharePoint], groups: int = GROUPS) -> list[SharePoint]:
    """Join neighbouring values into groups of about equal numbers of runs."""
    least = ceil(sum(point.runs for point in points) / groups)
    joined, waiting = list[SharePoint](), list[SharePoint]()
    for point in points:
        waiting.append(point)
        if sum(one.runs for one in waiting) >= least or point is points[-1]:
            joined.append(_joined(waiting))
            waiting.clear()
    return joined


def _joined(points: Sequence[SharePoint]) -> SharePoint:
    runs = sum(point.runs for point in points)
    return SharePoint(
        low=points[0].low,
        high=points[-1].high,
        runs=runs,
        broken=sum(point.broken for point in points),
        fitted=sum(point.runs * point.fitted for point in points) / runs,
    )


def deviance(points: Sequence[SharePoint]) -> float:
    """Deviance (G²) of the grouped counts from the curve."""
    total = 0.0
    for group in grouped(points):
        for count, fitted in (
            (group.broken, group.fitted),
            (group.runs - group.broken, 1.0 - group.fitted),
        ):
            if count:
                total += 2.0 * count * log(count / (group.runs * max(fitted, 1e-12)))
    return total
