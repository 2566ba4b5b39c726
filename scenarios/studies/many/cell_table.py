"""Results of a sweep by cell: quantiles of figures and shares of broken limits."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from scenarios.studies.job import Row
from scenarios.studies.many.plan import SweepFigure, SweepPlan, run_key
from scenarios.studies.many.variant import agresti_coull, mean_interval

SCHEMA = "convoy.sweep/2"


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRun:
    values: tuple[str, ...]
    seed: int
    command: str
    outcome: str = ""
    reason: str = ""
    error: str = ""
    figures: Sequence[float | None] = ()
    broken: Sequence[bool] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureSpread:
    """Quantiles and mean of a figure over the seeds of a cell, from the `count` runs that have it.

    The mean has its 95 % interval from two runs on; that of gains is the geometric mean.
    """

    count: int
    mean: float | None = None
    mean_low: float | None = None
    mean_high: float | None = None
    median: float | None = None
    p5: float | None = None
    p95: float | None = None
    minimum: float | None = None
    maximum: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitShare:
    """Number and share of runs that broke a limit, with the 95 % Agresti-Coull interval."""

    broken: int
    ratio: float | None
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepCell:
    """The runs of one combination of values; runs with an error count in `errors` only.

    `failed` runs broke a limit of the scenario or had a fault. `worst` is the run with the worst
    first figure.
    """

    values: tuple[str, ...]
    runs: tuple[SweepRun, ...]
    failed: int
    errors: int
    figures: tuple[FigureSpread, ...]
    limits: tuple[LimitShare, ...]
    worst: SweepRun


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepTable:
    """All cells of a sweep in the order of its axes."""

    plan: SweepPlan
    cells: tuple[SweepCell, ...]

    @property
    def errors(self) -> int:
        return sum(cell.errors for cell in self.cells)

    @property
    def worst(self) -> SweepRun:
        """The run with the worst first figure."""
        return max((cell.worst for cell in self.cells), key=_badness(self.plan.figures[0]))

    def rows(self) -> list[Row]:
        return [self._row(cell) for cell in self.cells]

    def run_rows(self) -> list[Row]:
        return [self._run_row(run) for cell in self.cells for run in cell.runs]

    def _keys(self, values: Sequence[str]) -> Row:
        return {axis.key: value for axis, value in zip(self.plan.axes, values, strict=True)}

    def _row(self, cell: SweepCell) -> Row:
        row = self._keys(cell.values)
        row |= {"runs": len(cell.runs), "failed": cell.failed, "errors": cell.errors}
        for figure, spread in zip(self.plan.figures, cell.figures, strict=True):
            row |= {f"{figure.name}.{key}": value for key, value in asdict(spread).items()}
        for limit, share in zip(self.plan.limits, cell.limits, strict=True):
            row |= {
                f"{limit}.broken": share.broken,
                f"{limit}.broken_ratio": share.ratio,
                f"{limit}.broken_ratio_low": share.low,
                f"{limit}.broken_ratio_high": share.high,
            }
        return row | {"worst_seed": cell.worst.seed, "worst_command": cell.worst.command}

    def _run_row(self, run: SweepRun) -> Row:
        row = self._keys(run.values) | {"seed": run.seed, "outcome": run.outcome}
        row |= {"reason": run.reason, "error": run.error}
        figures = run.figures or (None,) * len(self.plan.figures)
        broken = run.broken or (None,) * len(self.plan.limits)
        for figure, value in zip(self.plan.figures, figures, strict=True):
            row[figure.name] = value
        for limit, is_broken in zip(self.plan.limits, broken, strict=True):
            row[f"{limit}.broken"] = None if is_broken is None else int(is_broken)
        return row | {"command": run.command}


def table_of(plan: SweepPlan, entries: Mapping[str, Mapping[str, Any]]) -> SweepTable:
    """Summarize the journal entries of all runs by cell."""
    cells = []
    for number, overrides in enumerate(plan.cells):
        values = tuple(override.partition("=")[2] for override in overrides)
        runs = tuple(
            SweepRun(
                values=values,
                seed=variant.seed,
                command=variant.command,
                **entries[run_key(number, variant.seed)],
            )
            for variant in plan.variants(overrides)
        )
        sound = [run for run in runs if not run.error]
        cell = SweepCell(
            values=values,
            runs=runs,
            failed=sum(run.outcome == "failed" for run in sound),
            errors=len(runs) - len(sound),
            figures=tuple(
                _spread([run.figures[n] for run in sound], figure.is_gain)
                for n, figure in enumerate(plan.figures)
            ),
            limits=tuple(_share([run.broken[n] for run in sound]) for n in range(len(plan.limits))),
            worst=max(sound or runs, key=_badness(plan.figures[0])),
        )
        cells.append(cell)
    return SweepTable(plan=plan, cells=tuple(cells))


def _badness(figure: SweepFigure) -> Callable[[SweepRun], float]:
    """Key function by which `max` returns the worst run, of equal runs the first."""
    sign = -1.0 if figure.is_worst_when_least else 1.0

    def badness(run: SweepRun) -> float:
        value = run.figures[0] if run.figures else None
        return -np.inf if value is None else sign * value

    return badness


def _spread(values: Sequence[float | None], is_gain: bool) -> FigureSpread:
    known = [value for value in values if value is not None]
    if not known:
        return FigureSpread(count=0)
    p5, median, p95 = map(float, np.quantile(known, (0.05, 0.5, 0.95)))
    mean, low, high = mean_interval(known, is_gain=is_gain)
    return FigureSpread(
        count=len(known),
        mean=mean,
        mean_low=low,
        mean_high=high,
        median=median,
        p5=p5,
        p95=p95,
        minimum=min(known),
        maximum=max(known),
    )


def _share(broken: Sequence[bool]) -> LimitShare:
    count = sum(broken)
    low, high = agresti_coull(count, len(broken))
    ratio = count / len(broken) if broken else None
    return LimitShare(broken=count, ratio=ratio, low=low, high=high)


# ---- Files


CELLS, RUNS, JSON_FILE = "sweep.csv", "runs.csv", "sweep.json"


def tables_of(table: SweepTable) -> dict[str, Any]:
    """Return the files of a sweep by name: both tables as CSV and, with typed keys, as JSON."""
    cells, runs = table.rows(), table.run_rows()
    content = {
        "schema": SCHEMA,
        "configuration": table.plan.identity(),
        "cells": typed_rows(table, cells),
        "runs": typed_rows(table, runs),
    }
    return {CELLS: cells, RUNS: runs, JSON_FILE: content}


def typed_rows(table: SweepTable, rows: Sequence[Row]) -> list[Row]:
    numbers = {axis.key for axis in table.plan.axes if axis.numbers}
    return [
        {name: float(value) if name in numbers else value for name, value in row.items()}
        for row in rows
    ]
