"""Run a scenario over values and seeds: sweeps and boundaries."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scenarios.api.running import Settings, arguments_named, overrides_of
from scenarios.definition.errors import ScenarioError, require
from scenarios.definition.overrides import value_text
from scenarios.results.data_table import DataTable
from scenarios.studies.many.boundary import BoundaryQuery, BoundaryResult
from scenarios.studies.many.cell_table import SweepTable, typed_rows
from scenarios.studies.many.files import run_bisect, run_sweep
from scenarios.studies.many.plan import planned
from scenarios.studies.many.variant import limited_variant
from scenarios.studies.workers import OpenWorkers, open_workers


class Sweep:
    """Results of a sweep.

    `cells` has a row per combination of values, with quantiles of each metric, shares of broken
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


@arguments_named()
def sweep(
    scenario: str | Path = "lane_change",
    vary: Mapping[str, str | Sequence[Any]] | None = None,
    *,
    seeds: int = 20,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    metrics: Sequence[str] = (),
    limits: Sequence[str] = (),
    out: str | Path | None = None,
    picture: str | Path | None = None,
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
        metrics: Fields of the summary, by default "cross_track_error_m_max".
        limits: Limits to count, such as "lane" or "error_m=0.5".
        out: Folder for tables; an interrupted sweep resumes there. By default no files
            are written.
        picture: Draw metrics and limits into this new file; needs SciPy.
        workers: Number of worker processes, by default one per core; 0 simulates in this process.
        scheduler: Address of a dask scheduler whose workers simulate.
        report: Called with a line of progress every few seconds, such as `print`.

    Raises:
        Error: The scenario, a value, a metric or a limit is refused.

    """
    if picture is not None:
        require("picture", "studies", "scipy")
    plan = planned(
        str(scenario),
        vary=[f"{key}={values_text(key, values)}" for key, values in (vary or {}).items()],
        seeds=seeds,
        sets=overrides_of(set),
        metrics=metrics,
        limits=limits,
    )
    table, files = run_sweep(
        plan,
        None if out is None else Path(out),
        workers_of(workers, scheduler),
        report or _no_report,
        picture=None if picture is None else Path(picture),
    )
    return Sweep(table, files)


@arguments_named()
def bisect(
    scenario: str | Path,
    key: str,
    limit: str = "lane",
    *,
    range: tuple[float, float] = (0.0, 1.0),  # noqa: A002 - as on the command line
    share: float = 0.5,
    precision: float | None = None,
    runs: int = 1000,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    out: str | Path | None = None,
    pictures: bool = False,
    workers: int | None = None,
    scheduler: str = "",
    report: Callable[[str], None] | None = None,
) -> BoundaryResult:
    """Find the value at which runs break a limit, like `convoy bisect`.

    The result has `boundary` with the 95 % interval `low` to `high`, or the `finding` that there is
    none in the range.

    Args:
        scenario: A shipped name, a TOML file, or a recorded drive.
        key: A setting with a number, such as "links.loss_ratio".
        limit: The limit to test, such as "lane" or "v4.error_m=0.5".
        range: Smallest and largest value.
        share: Share of runs that break the limit at the boundary.
        precision: Stop at this half-width of the interval; by default a fiftieth of the range.
        runs: Maximum number of runs.
        set: Settings of all runs, by key.
        out: Folder for bisect.json. By default no files are written.
        pictures: Draw the plot into `out`.
        workers: Number of worker processes, by default one per core; 0 simulates in this process.
        scheduler: Address of a dask scheduler whose workers simulate.
        report: Called with a line of progress every few seconds, such as `print`.

    Raises:
        Error: The scenario, the key, the limit or a number is refused.

    """
    variant, parsed = limited_variant(str(scenario), overrides_of(set), limit)
    query = BoundaryQuery(
        variant=variant,
        key=key,
        limit=parsed,
        low=range[0],
        high=range[1],
        precision=precision,
        share=share,
        max_runs=runs,
    )
    result, _ = run_bisect(
        query,
        None if out is None else Path(out),
        workers_of(workers, scheduler),
        report or _no_report,
        picture_format="png" if pictures else None,
    )
    return result


def _no_report(_line: str) -> None:
    pass


def workers_of(workers: int | None, scheduler: str) -> OpenWorkers:
    if scheduler:
        require("scheduler", "dask", "distributed")
    return partial(open_workers, workers, scheduler)


def values_text(key: str, values: str | Sequence[Any]) -> str:
    if isinstance(values, str):
        return values
    try:
        return ",".join(map(value_text, values))
    except TypeError as error:
        raise ScenarioError([f"vary: {key}: {error}"]) from error
