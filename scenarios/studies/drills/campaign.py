"""Many drills, each with one or more seeds: their limits as rows, and for machines."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from scenarios.runs.pool import RunAll
from scenarios.studies.drills.drill import DrillRow, DrillRun, carry_out_drill, rows_of
from scenarios.studies.many.variant import Variant

SCHEMA = "convoy.drills/1"
TWIN = "drills.json"
SAY_EVERY_S = 3.0

Key = tuple[str, int]
"""A drill and a seed."""


def carry_out_drills(
    variants: Sequence[Variant], progress: Callable[[str], None], run_all: RunAll
) -> list[DrillRun]:
    """Drive all of them in virtual time; a result for each, in the order of `variants`."""
    jobs = {(one.name, one.seed): partial(carry_out_drill, one) for one in variants}
    found: dict[Key, DrillRun] = {}
    began = said = time.monotonic()
    for key, run in run_all(jobs):
        found[key] = run
        now = time.monotonic()
        if now - said > SAY_EVERY_S or len(found) == len(jobs):
            said = now
            left = (now - began) * (len(jobs) / len(found) - 1.0)
            progress(f"{now - began:5.1f} s  {len(found)} of {len(jobs)} runs, {left:.0f} s left")
    return [found[key] for key in jobs]


def drill_rows(runs: Sequence[DrillRun]) -> list[DrillRow]:
    """Give a row for each limit of each drill, in the order of the drills; the worst of all seeds.

    A drill whose run gave no figure at all has failed, too.
    """
    names = dict.fromkeys(run.drill for run in runs)
    return [row for name in names for row in rows_of([run for run in runs if run.drill == name])]


def write_twin(rows: Sequence[DrillRow], runs: Sequence[DrillRun], out: Path) -> Path:
    """Write the rows, and all figures of all runs, as `drills.json` into `out`."""
    out.mkdir(parents=True, exist_ok=True)
    file = out / TWIN
    text = json.dumps(machine_readable(rows, runs), indent=1, allow_nan=False)
    with file.open("x", encoding="utf-8") as target:
        target.write(text + "\n")
    return file


def machine_readable(rows: Sequence[DrillRow], runs: Sequence[DrillRun]) -> dict[str, Any]:
    """Give the rows, and each limit of each run, as JSON has them."""
    return {
        "schema": SCHEMA,
        "passed": all(row.passed for row in rows),
        "rows": [asdict(row) for row in rows],
        "runs": [
            {key: value for key, value in asdict(run).items() if key != "took_s"} for run in runs
        ],
    }
