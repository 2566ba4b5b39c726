"""Figures of whole runs with a cut, and of all runs with one variant."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from math import isfinite
from statistics import quantiles

from scenarios.studies.cuts.cut import LinkCut, Variant
from scenarios.studies.cuts.cut_figures import CutFigures

BLIND_RATIO, BLIND_M = 0.05, 0.5
"""Allowed error of the predicted blind distance: a ratio, or at least a distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunFigures:
    """Figures of all followers in one run (m, s); counts of departures and collisions."""

    cut: LinkCut
    error: float
    departures: int
    departures_avoidable: int
    collisions: int
    stood: float
    resumed: bool
    """Whether all cars drove on after the cut; not after one for good."""
    blind: float
    blind_deviation: float
    """Largest difference of driven and predicted blind distance above the allowed one; 0 if none
    is above."""

    @property
    def failed(self) -> bool:
        """Whether cars collided, left the lane avoidably, or mispredicted their blind distance."""
        return bool(self.collisions or self.departures_avoidable or self.blind_deviation)


def figures_of_runs(rows: Sequence[CutFigures]) -> list[RunFigures]:
    """Join the rows of each run, which are in sequence."""
    return [_figures_of_run(cut, list(run)) for cut, run in groupby(rows, lambda row: row.cut)]


def _figures_of_run(cut: LinkCut, rows: Sequence[CutFigures]) -> RunFigures:
    return RunFigures(
        cut=cut,
        error=max(row.error for row in rows),
        departures=sum(row.departures for row in rows),
        departures_avoidable=sum(row.departures_avoidable for row in rows),
        collisions=sum(row.collisions for row in rows),
        stood=max(row.stood for row in rows),
        resumed=all(isfinite(row.resumed_after) for row in rows),
        blind=max(row.blind or 0.0 for row in rows),
        blind_deviation=max(blind_deviation(row) for row in rows),
    )


def blind_deviation(row: CutFigures) -> float:
    """Difference (m) of driven and predicted blind distance, 0 if it is allowed."""
    if row.blind is None or row.predicted_blind is None:
        return 0.0
    off = abs(row.blind - row.predicted_blind)
    return off if off > max(BLIND_M, BLIND_RATIO * row.predicted_blind) else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class VariantFigures:
    """Figures of all runs with one variant: counts of runs, m and s."""

    variant: Variant
    runs: int
    departed: int
    departed_avoidably: int
    collided: int
    blind_mispredicted: int
    error_m_median: float
    error_m_95: float
    error_m_max: float
    blind_m_max: float
    stood_s_max: float
    resumed_ratio: float


def summary_of_variant(rows: Sequence[CutFigures]) -> VariantFigures:
    runs = figures_of_runs(rows)
    errors = quantiles([run.error for run in runs], n=20, method="inclusive")
    ended = [run for run in runs if run.cut.for_s is not None]
    return VariantFigures(
        variant=rows[0].cut.variant,
        runs=len(runs),
        departed=sum(run.departures > 0 for run in runs),
        departed_avoidably=sum(run.departures_avoidable > 0 for run in runs),
        collided=sum(run.collisions > 0 for run in runs),
        blind_mispredicted=sum(run.blind_deviation > 0.0 for run in runs),
        error_m_median=errors[9],
        error_m_95=errors[18],
        error_m_max=max(run.error for run in runs),
        blind_m_max=max(run.blind for run in runs),
        stood_s_max=max(run.stood for run in runs),
        resumed_ratio=sum(run.resumed for run in ended) / max(len(ended), 1),
    )
