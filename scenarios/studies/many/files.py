"""`convoy bisect`: the search, all figures as JSON, and the plot."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scenarios.results.figure_style import require_new_picture
from scenarios.studies.engine import JOURNAL, Engine, open_journal, study_engine
from scenarios.studies.job import require_place, write_file, write_files
from scenarios.studies.many.boundary import BoundaryQuery, BoundaryResult, find_boundary
from scenarios.studies.many.cell_table import (
    CELLS,
    JSON_FILE,
    RUNS,
    SweepTable,
    table_of,
    tables_of,
)
from scenarios.studies.many.plan import SweepPlan, refuse_picture
from scenarios.studies.workers import OpenWorkers

SCHEMA = "convoy.bisect/2"
PICTURE, BISECT_FILE = "boundary", "bisect.json"


def run_bisect(
    query: BoundaryQuery,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    picture_format: str | None = "png",
) -> tuple[BoundaryResult, list[Path]]:
    """Search for a boundary; return the result and the files written.

    Without a `picture_format` there is no plot, and without a folder no file. Raises ScenarioError
    if the query is invalid.
    """
    query.check()
    files = (BISECT_FILE, *([f"{PICTURE}.{picture_format}"] if picture_format else []))
    if out is not None:
        require_place(out, files)
    with study_engine(open_workers, report, plug_ins=query.variant.scenario.plug_ins) as engine:
        result = find_boundary(query, engine)
    if out is None:
        return result, []
    contents: dict[str, Any] = {BISECT_FILE: readable_result(query, result)}
    if picture_format:
        from scenarios.studies.many.pictures import drawn  # noqa: PLC0415 - brings matplotlib

        contents[f"{PICTURE}.{picture_format}"] = drawn(query, result)
    return result, write_files(out, contents)


def readable_result(query: BoundaryQuery, result: BoundaryResult) -> dict[str, Any]:
    points = [
        {"value": one.low, "runs": one.runs, "broken": one.broken, "fitted": one.fitted}
        for one in result.points
    ]
    return {
        "schema": SCHEMA,
        "scenario": query.variant.name,
        "overrides": list(query.variant.overrides),
        "key": query.key,
        "limit": str(query.limit),
        "range": [query.low, query.high],
        "precision": query.half_width,
        "share": query.share,
        **asdict(result),
        "points": points,
    }


# ---- `convoy sweep`: runs, tables and the picture


def run_sweep(
    plan: SweepPlan,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    picture: Path | None = None,
) -> tuple[SweepTable, list[Path]]:
    """Simulate the runs that are not in the journal in `out`; return table and files.

    An interrupted sweep resumes with the same results. Without a folder there are no tables. Raises
    ScenarioError if the folder holds other files, or if the keys cannot be drawn into the new file
    `picture`.
    """
    if picture is not None:
        refuse_picture(plan)
        require_new_picture(picture)
    with ExitStack() as stack:
        journal = None
        if out is not None:
            if not (out / JOURNAL).exists():
                require_place(out, (CELLS, RUNS, JSON_FILE))
            journal = stack.enter_context(open_journal(out, plan.identity(), report))
        engine = stack.enter_context(
            study_engine(open_workers, report, plug_ins=plan.plug_ins, journal=journal)
        )
        table = table_of(plan, _entries(plan, engine))
        written = [] if out is None else write_files(out, tables_of(table))
        if picture is not None:
            from scenarios.studies.many.pictures import sweep_picture  # noqa: PLC0415 - an extra

            write_file(picture, sweep_picture(table))
            written.append(picture)
        return table, written


def _entries(plan: SweepPlan, engine: Engine) -> dict[str, dict[str, Any]]:
    jobs = plan.jobs()
    done = engine.count_done(jobs)
    if done:
        engine.report(f"{done} of {plan.runs} runs are in the journal, {plan.runs - done} left")
    engine.progress.total = plan.runs
    return {
        key: {"error": found.error} if found.error else dict(found.result)
        for key, found in engine.outcomes(jobs)
    }
