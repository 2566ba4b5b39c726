"""Random cuts, simulated with each reaction, and their figures."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from scenarios.results.versions import current_stamp
from scenarios.studies.cuts.cut import CutFigures, LinkCut, run_cut
from scenarios.studies.engine.engine import Engine, study_engine
from scenarios.studies.engine.job import Job
from scenarios.studies.engine.results import write_files
from scenarios.studies.engine.workers import open_workers
from vehicles.driver.degradation.settings import Reaction

SCHEMA = "convoy.cuts/1"
PICTURE, JSON_FILE = "cuts", "cuts.json"
REACTIONS: tuple[Reaction, ...] = ("degrade", "extrapolate", "hold", "straight")
SPEEDS_MPS = 8.0, 30.0
CUT_AT_S = 3.0, 17.0
"""From when the convoy has formed until its last car has left both lane changes."""
SHORT_S, LONG_S = (0.3, 4.0), 14.0
"""Half of the cuts are short, from a range; the other half last until all cars have stopped."""


def draw_cuts(count: int, reaction: Reaction, seed: int = 1) -> Iterator[LinkCut]:
    """Draw cuts at random times and speeds, the same for each reaction."""
    random = np.random.Generator(np.random.PCG64(seed))
    for number in range(count):
        yield LinkCut(
            reaction=reaction,
            speed_mps=round(float(random.uniform(*SPEEDS_MPS)), 2),
            at_s=round(float(random.uniform(*CUT_AT_S)), 3),
            for_s=LONG_S if number % 2 else round(float(random.uniform(*SHORT_S)), 3),
            seed=number + 1,
        )


def run_cuts(cuts: Sequence[LinkCut], engine: Engine) -> list[CutFigures]:
    """Simulate all cuts; return a row per follower, in the order of `cuts`."""
    jobs = [
        Job(key=f"{cut.reaction} {cut.seed}", work=partial(_fields, cut), command=str(cut))
        for cut in cuts
    ]
    engine.progress.total = len(jobs)
    rows = TypeAdapter(list[CutFigures])
    return [row for fields in engine.results(jobs) for row in rows.validate_python(fields)]


def _fields(cut: LinkCut) -> list[dict[str, Any]]:
    return [asdict(row) for row in run_cut(cut)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReactionFigures:
    """Figures of all followers with one reaction."""

    reaction: Reaction
    cuts: int
    error_m_median: float
    error_m_max: float
    error_on_known_path_m_max: float
    blind_m_max: float
    stopped_ratio: float
    friction_ratio_max: float
    resumed_ratio: float


def summary_of_reaction(rows: Sequence[CutFigures]) -> ReactionFigures:
    return ReactionFigures(
        reaction=rows[0].cut.reaction,
        cuts=len({row.cut for row in rows}),
        error_m_median=median(row.error for row in rows),
        error_m_max=max(row.error for row in rows),
        error_on_known_path_m_max=max(row.error_on_known_path for row in rows),
        blind_m_max=max(row.blind for row in rows),
        stopped_ratio=sum(row.stopped for row in rows) / len(rows),
        friction_ratio_max=max(row.friction for row in rows),
        resumed_ratio=sum(isfinite(row.resumed_after) for row in rows) / len(rows),
    )


def run_campaign(
    count: int,
    out: Path,
    progress: Callable[[str], None],
    *,
    workers: int | None = None,
    picture_format: str = "png",
) -> list[ReactionFigures]:
    """Simulate `count` cuts with each reaction; write plot and JSON into `out`.

    Uses all cores by default. Raises ScenarioError if one of both files exists.
    """
    from scenarios.studies.cuts.error_plots import drawn_figure  # noqa: PLC0415 - matplotlib

    picture = f"{PICTURE}.{picture_format}"
    cuts = [cut for reaction in REACTIONS for cut in draw_cuts(count, reaction)]
    with study_engine(
        partial(open_workers, workers),
        progress,
        out=out,
        files=(picture, JSON_FILE),
        identity={"--cuts": count, **asdict(current_stamp())},
    ) as engine:
        rows = run_cuts(cuts, engine)
        by_reaction = {
            reaction: [row for row in rows if row.cut.reaction == reaction]
            for reaction in REACTIONS
        }
        summaries = [summary_of_reaction(own) for own in by_reaction.values()]
        write_files(
            out, {JSON_FILE: machine_readable(summaries, rows), picture: drawn_figure(by_reaction)}
        )
    return summaries


def machine_readable(
    summaries: Sequence[ReactionFigures], rows: Sequence[CutFigures]
) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "reactions": [asdict(summary) for summary in summaries],
        "rows": [
            {
                key: None if isinstance(value, float) and not isfinite(value) else value
                for key, value in asdict(row).items()
            }
            for row in rows
        ],
    }
