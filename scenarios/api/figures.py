"""Standard figures of the field."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from scenarios.api.running import Settings, overrides_of
from scenarios.api.sweeping import values_text, workers_of
from scenarios.definition.errors import ScenarioError, require
from scenarios.results.recorded.data_table import DataTable
from scenarios.studies.figures.registry import FIGURE_STUDIES
from scenarios.studies.figures.simulated import run_figure
from scenarios.studies.figures.study import FigureOptions, FigureResult


class FigureData:
    """Points of a figure with their 95 % intervals over the seeds.

    `points` has a row per panel, series and value `x`, with `mean`, `low` and `high`, and the
    `count` of the runs that have the quantity. `outcome` is the result in a line, `commands` are
    the sweeps behind it, and `files` were written.
    """

    def __init__(self, result: FigureResult, files: Sequence[Path]) -> None:
        self.points = DataTable.of_rows(result.rows())
        self.outcome = result.outcome
        self.commands = tuple(result.study.commands)
        self.files = tuple(files)

    def __repr__(self) -> str:
        return f"<FigureData: {self.outcome}>"

    def _repr_html_(self) -> str:
        return self.points._repr_html_()


def figure(
    name: str,
    scenario: str | Path = "",
    *,
    seeds: int | None = None,
    vary: Mapping[str, str | Sequence[Any]] | None = None,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    out: str | Path | None = None,
    pictures: bool = False,
    workers: int | None = None,
    scheduler: str = "",
    report: Callable[[str], None] | None = None,
) -> FigureData:
    """Simulate the sweeps of a figure, like `convoy figure`. Needs SciPy.

    Args:
        name: "cacc", "error-along-string" or "loss-over-gap".
        scenario: A shipped name or a TOML file, by default that of the figure.
        seeds: Simulate each combination with the seeds 1 to this one.
        vary: Values of the axes of the figure by key, like those of `convoy.sweep`.
        set: Settings of all runs, by key.
        out: Folder for table, JSON and picture; an interrupted study resumes there. By default no
            files are written.
        pictures: Draw the picture into `out`; needs Matplotlib.
        workers: Number of worker processes, by default one per core; 0 simulates in this process.
        scheduler: Address of a dask scheduler whose workers simulate.
        report: Called with a line of progress every few seconds, such as `print`.

    Raises:
        Error: The name, the scenario or a value is refused, or a run raised an error.

    """
    require("figure", "studies", "scipy", *(["matplotlib"] if pictures else []))
    if name not in FIGURE_STUDIES:
        raise ScenarioError([f"figure: given {name!r}, allowed {', '.join(FIGURE_STUDIES)}"])
    options = FigureOptions(
        scenario=str(scenario),
        seeds=seeds,
        vary=tuple(f"{key}={values_text(key, values)}" for key, values in (vary or {}).items()),
        sets=tuple(overrides_of(set)),
    )
    result, files = run_figure(
        FIGURE_STUDIES[name](options),
        None if out is None else Path(out),
        workers_of(workers, scheduler),
        report or (lambda _line: None),
        picture_format="png" if pictures else None,
    )
    return FigureData(result, files)
