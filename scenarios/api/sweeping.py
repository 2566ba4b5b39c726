"""Run a scenario over values and seeds."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scenarios.api.running import Settings, overrides_of
from scenarios.definition.errors import ScenarioError, require
from scenarios.definition.overrides import value_text
from scenarios.results.recorded.data_table import DataTable
from scenarios.studies.engine.workers import open_workers
from scenarios.studies.many.sweeps.cell_table import SweepTable, typed_rows
from scenarios.studies.many.sweeps.plan import planned
from scenarios.studies.many.sweeps.sweep import run_sweep


class Sweep:
    """Results of a sweep.

    `cells` has a row per combination of values, with quantiles of each figure, shares of broken
    limits and the command that repeats the worst run; `runs` has a row per run. `files` were
    written. Runs with an error have a text in the column `error`.
    """

    def __init__(self, table: SweepTable, files: Sequence[Path]) -> None:
        self.cells = DataTable.of_rows(typed_rows(table, table.rows()))
        self.runs = DataTable.of_rows(typed_rows(table, table.run_rows()))
        self.worst_command = table.worst.command
        self.files = tuple(files)

    def __repr__(self) -> str:
        return f"<Sweep: {len(self.cells)} cells, {len(self.runs)} runs>"

    def _repr_html_(self) -> str:
        return self.cells._repr_html_()


def sweep(
    scenario: str | Path = "lane_change",
    vary: Mapping[str, str | Sequence[Any]] | None = None,
    *,
    seeds: int = 20,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    figures: Sequence[str] = (),
    limits: Sequence[str] = (),
    out: str | Path | None = None,
    pictures: bool = False,
    workers: int | None = None,
    scheduler: str = "",
    report: Callable[[str], None] | None = None,
) -> Sweep:
    """Simulate each combination of values with each seed, like `convoy sweep`.

    Args:
        scenario: A shipped name, a TOML file, or a recorded drive.
        vary: Values by key: a list, or a range "START:STOP:STEP" that includes both ends.
        seeds: Simulate each combination with the seeds 1 to this one.
        set: Settings of all runs, by key.
        figures: Fields of the summary, by default "cross_track_error_m_max".
        limits: Limits to count, such as "lane" or "error_m=0.5".
        out: Folder for tables and plots; an interrupted sweep resumes there. By default no files
            are written.
        pictures: Draw plots into `out`; needs Matplotlib.
        workers: Number of worker processes, by default one per core; 0 simulates in this process.
        scheduler: Address of a dask scheduler whose workers simulate.
        report: Called with a line of progress every few seconds, such as `print`.

    Raises:
        Error: The scenario, a value, a figure or a limit is refused.

    """
    if pictures:
        require("pictures=True", "studies", "matplotlib")
    if scheduler:
        require("scheduler", "dask", "distributed")
    plan = planned(
        str(scenario),
        vary=[f"{key}={_values(key, values)}" for key, values in (vary or {}).items()],
        seeds=seeds,
        sets=overrides_of(set),
        figures=figures,
        limits=limits,
    )
    table, files = run_sweep(
        plan,
        None if out is None else Path(out),
        partial(open_workers, workers, scheduler),
        report or (lambda _: None),
        picture_format="png" if pictures else None,
    )
    return Sweep(table, files)


def _values(key: str, values: str | Sequence[Any]) -> str:
    if isinstance(values, str):
        return values
    try:
        return ",".join(map(value_text, values))
    except TypeError as error:
        raise ScenarioError([f"vary: {key}: {error}"]) from error
