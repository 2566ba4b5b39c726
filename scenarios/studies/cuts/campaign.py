"""Random cuts, simulated with each variant, and their figures."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter

from scenarios.results.versions import current_stamp
from scenarios.studies.cuts.cut import LINKS, Fix, LinkCut, Variant
from scenarios.studies.cuts.cut_figures import CutFigures, run_cut
from scenarios.studies.cuts.roads import ROADS, Road
from scenarios.studies.cuts.run_figures import VariantFigures, figures_of_runs, summary_of_variant
from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.job import Job
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import open_workers

SCHEMA = "convoy.cuts/2"
PICTURE, JSON_FILE = "cuts", "cuts.json"
FAILURES = "failures"
"""Folder with the scenarios of runs that failed."""
Comparison = Literal["history", "reaction"]
VARIANTS: Mapping[Comparison, tuple[Variant, ...]] = {
    "history": ("history", "no_history"),
    "reaction": ("degrade", "extrapolate", "hold", "straight"),
}
VEHICLES = 3, 8
SPEEDS_MPS = 8.0, 30.0
CUT_AT_S = 3.0, 17.0
"""From when the convoy has formed until its last car has left both lane changes."""
CUT_FOR_S = 0.2, 8.0
FOR_GOOD, FLAPPING = 0.2, 0.2
"""Shares of permanent cuts, and of flapping links."""
FIXES: tuple[Fix, ...] = ("", "", "", "float", "none")


def draw_cuts(
    count: int, variant: Variant, roads: Sequence[Road] = ROADS, seed: int = 1
) -> Iterator[LinkCut]:
    """Draw cuts over the roads in turn, the same for each variant and any count."""
    for number in range(count):
        random = np.random.Generator(np.random.PCG64([seed, number]))
        vehicles = int(random.integers(*VEHICLES, endpoint=True))
        for_s = round(float(random.uniform(*CUT_FOR_S)), 3)
        yield LinkCut(
            variant=variant,
            road=roads[number % len(roads)],
            speed_mps=round(float(random.uniform(*SPEEDS_MPS)), 2),
            at_s=round(float(random.uniform(*CUT_AT_S)), 3),
            for_s=None if random.random() < FOR_GOOD else for_s,
            seed=number + 1,
            vehicles=vehicles,
            links=LINKS[random.integers(len(LINKS))],
            flapping=bool(random.random() < FLAPPING),
            vehicle=int(random.integers(2, vehicles, endpoint=True)),
            fix=FIXES[random.integers(len(FIXES))],
        )


def run_cuts(cuts: Sequence[LinkCut], engine: Engine) -> list[CutFigures]:
    """Simulate all cuts; return a row per follower, in the order of `cuts`."""
    jobs = [
        Job(key=f"{cut.variant} {cut.seed}", work=partial(_fields, cut), command=str(cut))
        for cut in cuts
    ]
    engine.progress.total = len(jobs)
    rows = TypeAdapter(list[CutFigures])
    return [row for fields in engine.results(jobs) for row in rows.validate_python(fields)]


def _fields(cut: LinkCut) -> list[dict[str, Any]]:
    return [asdict(row) for row in run_cut(cut)]


def run_campaign(
    count: int,
    out: Path,
    progress: Callable[[str], None],
    *,
    comparison: Comparison = "history",
    roads: Sequence[Road] = ROADS,
    workers: int | None = None,
    picture_format: str = "png",
) -> list[VariantFigures]:
    """Simulate `count` cuts with each variant; write plot, JSON and failures into `out`.

    Uses all cores by default. Raises ScenarioError if the plot or the JSON exists.
    """
    from scenarios.studies.cuts.error_plots import drawn_figure  # noqa: PLC0415 - matplotlib

    picture = f"{PICTURE}.{picture_format}"
    variants = VARIANTS[comparison]
    cuts = [cut for variant in variants for cut in draw_cuts(count, variant, roads)]
    with study_engine(
        partial(open_workers, workers),
        progress,
        out=out,
        files=(picture, JSON_FILE),
        identity={"--cuts": count, "--road": list(roads), **asdict(current_stamp())},
    ) as engine:
        rows = run_cuts(cuts, engine)
        by_variant = {
            variant: [row for row in rows if row.cut.variant == variant] for variant in variants
        }
        summaries = [summary_of_variant(own) for own in by_variant.values()]
        write_files(
            out, {JSON_FILE: machine_readable(summaries, rows), picture: drawn_figure(by_variant)}
        )
        write_files(out / FAILURES, dict(failures(rows)))
    return summaries


def failures(rows: Sequence[CutFigures]) -> Iterator[tuple[str, str]]:
    """Yield the file name and the scenario of each run that failed."""
    for run in figures_of_runs(rows):
        if run.failed:
            yield f"{run.cut.variant}_{run.cut.seed}.toml", run.cut.text()


def machine_readable(
    summaries: Sequence[VariantFigures], rows: Sequence[CutFigures]
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "variants": [asdict(summary) for summary in summaries],
        "rows": [
            {
                key: None if isinstance(value, float) and not isfinite(value) else value
                for key, value in asdict(row).items()
            }
            for row in rows
        ],
    }
