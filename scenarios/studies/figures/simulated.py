"""Simulate the sweeps of a figure, and write its picture and tables."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import OpenWorkers
from scenarios.studies.figures.study import FigureResult, FigureStudy, collisions_in
from scenarios.studies.many.sweeps.cell_table import SweepTable, table_of
from scenarios.studies.many.sweeps.plan import SweepPlan

SCHEMA = "convoy.figure/1"


def run_figure(
    study: FigureStudy,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    picture_format: str | None = "png",
) -> tuple[FigureResult, list[Path]]:
    """Simulate the sweeps; return the points and the files: table, JSON and picture.

    An interrupted study resumes. Without a folder no files are written, without a
    `picture_format` no picture. Raises ScenarioError if the folder holds other files.
    """
    files = [f"{study.name}.{kind}" for kind in ("csv", "json", picture_format) if kind]
    identity = {"figure": study.name, "plug_ins": _plug_ins(study.sweeps.values())} | {
        label: plan.identity() for label, plan in study.sweeps.items()
    }
    with study_engine(open_workers, report, out=out, files=files, identity=identity) as engine:
        tables = _simulated(study, engine)
        points = tuple(study.points(tables))
        outcome = study.outcome(points) + collisions_in(tables)
        result = FigureResult(study=study, points=points, outcome=outcome)
        if out is None:
            return result, []
        contents: list[Any] = [result.rows(), machine_readable(result)]
        if picture_format:
            from scenarios.studies.figures.drawing import drawn  # noqa: PLC0415 - an extra

            contents.append(drawn(result))
        return result, write_files(out, dict(zip(files, contents, strict=True)))


def _simulated(study: FigureStudy, engine: Engine) -> dict[str, SweepTable]:
    """Run the sweeps side by side; an error of a run ends the study."""
    jobs = {
        label: [replace(job, key=f"{label}/{job.key}") for job in plan.jobs()]
        for label, plan in study.sweeps.items()
    }
    every = [job for of_plan in jobs.values() for job in of_plan]
    engine.progress.total = len(every)
    entries = dict(zip([job.key for job in every], engine.results(every), strict=True))
    return {
        label: table_of(
            plan, {job.key.removeprefix(f"{label}/"): entries[job.key] for job in jobs[label]}
        )
        for label, plan in study.sweeps.items()
    }


def _plug_ins(plans: Iterable[SweepPlan]) -> dict[str, str]:
    digests: dict[str, str] = {}
    for plan in plans:
        digests |= plan.identity()["plug_ins"]
    return digests


def machine_readable(result: FigureResult) -> dict[str, Any]:
    study = result.study
    return {
        "schema": SCHEMA,
        "figure": study.name,
        "title": study.title,
        "outcome": result.outcome,
        "sweeps": {label: plan.identity() for label, plan in study.sweeps.items()},
        "commands": study.commands,
        "points": result.rows(),
    }
