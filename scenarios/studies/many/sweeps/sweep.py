"""`convoy sweep`: runs, tables and plots."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from scenarios.studies.engine.dispatcher import Outcome
from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import OpenWorkers
from scenarios.studies.many.sweeps.cell_table import (
    SweepTable,
    machine_readable,
    table_of,
    typed_rows,
)
from scenarios.studies.many.sweeps.plan import SweepPlan
from scenarios.studies.picture_style import encoded, picture_format_of

CELLS, RUNS, JSON_FILE = "sweep.csv", "runs.csv", "sweep.json"
PARQUET = ("sweep.parquet", "runs.parquet")
SWEEP, SEEDS = "sweep", "seeds"


def run_sweep(
    plan: SweepPlan,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    parquet: bool = False,
    picture_format: str | None = "png",
) -> tuple[SweepTable, list[Path]]:
    """Simulate the runs that are not in the journal in `out`; return table and files.

    An interrupted sweep resumes with the same results. Without a `picture_format` there are no
    plots, and without a folder no files. Raises ScenarioError if the folder holds other files.
    """
    plots = [f"{name}.{picture_format}" for name in (SWEEP, SEEDS) if picture_format]
    files = (CELLS, RUNS, JSON_FILE, *plots, *PARQUET)
    with study_engine(
        open_workers, report, out=out, files=files, identity=plan.identity(), keep_journal=True
    ) as engine:
        table = table_of(plan, _entries(plan, engine))
        if out is None:
            return table, []
        contents = tables_of(table, parquet=parquet)
        if picture_format:
            contents |= drawn(table, report, picture_format)
        return table, write_files(out, contents)


def _entries(plan: SweepPlan, engine: Engine) -> dict[str, dict[str, Any]]:
    jobs = plan.jobs()
    done = engine.count_done(jobs)
    if done:
        engine.report(f"{done} of {plan.runs} runs are in the journal, {plan.runs - done} left")
    engine.progress.total = plan.runs
    return {outcome.key: _entry(outcome) for outcome in engine.outcomes(jobs)}


def _entry(outcome: Outcome) -> dict[str, Any]:
    return {"error": outcome.error} if outcome.error else dict(outcome.result)


def tables_of(table: SweepTable, *, parquet: bool = False) -> dict[str, Any]:
    cells, runs = table.rows(), table.run_rows()
    contents: dict[str, Any] = {CELLS: cells, RUNS: runs, JSON_FILE: machine_readable(table)}
    if parquet:
        for name, rows in zip(PARQUET, (cells, runs), strict=True):
            contents[name] = typed_rows(table, rows)
    return contents


def draw_sweep(table: SweepTable, path: Path) -> Path:
    """Draw the plot of a sweep into a file; raises ScenarioError if it cannot be drawn."""
    from scenarios.studies.many.sweeps.plots import (  # noqa: PLC0415 - needs Matplotlib
        sweep_figure,
        why_no_plot,
    )

    if why_not := why_no_plot(table):
        raise ScenarioError([f"--output: {why_not}"])
    write_whole(path, encoded(sweep_figure(table), picture_format_of(path)), new=True)
    return path


def drawn(
    table: SweepTable, report: Callable[[str], None], picture_format: str = "png"
) -> dict[str, Any]:
    """Return all plots by file name; the reason for a missing plot goes to `report`."""
    from scenarios.studies.many.sweeps.plots import (  # noqa: PLC0415 - needs Matplotlib
        seeds_figure,
        sweep_figure,
        why_no_plot,
    )

    if why_not := why_no_plot(table):
        report(why_not)
        figures = {SEEDS: seeds_figure(table)}
    else:
        figures = {SWEEP: sweep_figure(table), SEEDS: seeds_figure(table)}
    return {f"{name}.{picture_format}": figure for name, figure in figures.items()}
