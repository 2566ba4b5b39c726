"""`convoy sweep`: runs, tables and the picture."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from scenarios.studies.engine.dispatcher import Outcome
from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.results import write_file, write_files
from scenarios.studies.engine.workers import OpenWorkers
from scenarios.studies.many.sweeps.cell_table import (
    SweepTable,
    machine_readable,
    table_of,
    typed_rows,
)
from scenarios.studies.many.sweeps.plan import SweepPlan, refuse_picture
from scenarios.studies.picture_style import require_new_picture

CELLS, RUNS, JSON_FILE = "sweep.csv", "runs.csv", "sweep.json"
PARQUET = ("sweep.parquet", "runs.parquet")


def run_sweep(
    plan: SweepPlan,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    parquet: bool = False,
    picture: Path | None = None,
) -> tuple[SweepTable, list[Path]]:
    """Simulate the runs that are not in the journal in `out`; return table and files.

    An interrupted sweep resumes with the same results. Without a folder there are no tables. Raises
    ScenarioError if the folder holds other files, or if the keys cannot be drawn into the new file
    `picture`, which needs Matplotlib.
    """
    if picture is not None:
        refuse_picture(plan)
        require_new_picture(picture)
    files = (CELLS, RUNS, JSON_FILE, *PARQUET)
    with study_engine(
        open_workers, report, out=out, files=files, identity=plan.identity(), keep_journal=True
    ) as engine:
        table = table_of(plan, _entries(plan, engine))
        written = [] if out is None else write_files(out, tables_of(table, parquet=parquet))
        if picture is not None:
            from scenarios.studies.many.sweeps.picture import sweep_picture  # noqa: PLC0415 - extra

            write_file(picture, sweep_picture(table))
            written.append(picture)
        return table, written


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
