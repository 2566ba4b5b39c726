"""`convoy bisect`: the search with its journal, all figures as JSON, and the plot."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from scenarios.studies.engine.engine import study_engine
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import OpenWorkers
from scenarios.studies.many.boundary.boundary_search import (
    BoundaryQuery,
    BoundaryResult,
    find_boundary,
)

SCHEMA = "convoy.bisect/2"
PICTURE, JSON_FILE = "boundary", "bisect.json"


def run_bisect(
    query: BoundaryQuery,
    out: Path | None,
    open_workers: OpenWorkers,
    report: Callable[[str], None],
    *,
    picture_format: str | None = "png",
) -> tuple[BoundaryResult, list[Path]]:
    """Search for a boundary; return the result and the files written.

    An interrupted search resumes in the folder `out`. Without a `picture_format` there is no plot,
    and without a folder no file. Raises ScenarioError if the query is invalid.
    """
    query.check()
    files = (JSON_FILE, *([f"{PICTURE}.{picture_format}"] if picture_format else []))
    with study_engine(
        open_workers, report, out=out, files=files, identity=query.identity()
    ) as engine:
        result = find_boundary(query, engine)
        if out is None:
            return result, []
        contents: dict[str, Any] = {JSON_FILE: machine_readable(query, result)}
        if picture_format:
            from scenarios.studies.many.boundary.boundary_picture import (  # noqa: PLC0415 - an extra
                drawn,
            )

            contents[f"{PICTURE}.{picture_format}"] = drawn(query, result)
        return result, write_files(out, contents)


def machine_readable(query: BoundaryQuery, result: BoundaryResult) -> dict[str, Any]:
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
