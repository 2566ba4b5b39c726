"""The runs of a folder in Rerun's catalog."""

from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from scenarios.definition.errors import ScenarioError, require
from scenarios.definition.scenario import Scenario
from scenarios.results.log_summary import log_in, scenario_of
from scenarios.results.pictures.review import review
from scenarios.results.pictures.run_drawing import recording_id, widest_spacing
from scenarios.studies.run_list import MISSING, UNREADABLE, ListedRun
from transport.picture.option import RerunOption
from transport.picture.viewer_process import ViewerError, require_display
from transport.texts import ConvoyError

if TYPE_CHECKING:  # an extra
    from transport.picture.comparison.catalog import CatalogEntry, CatalogLayout

DATASET = "runs"


def show_catalog(
    runs: Sequence[ListedRun],
    option: RerunOption,
    wait: Callable[[str, str], None],
    report: Callable[[str], None],
    until: Callable[[], bool] = lambda: False,
) -> None:
    """Draw the runs, and show them with their figures until `wait` returns.

    `wait` gets the address of the catalog and where it is shown; `report` gets progress and faults
    of logs. Drawing ends early if `until` is true. Unreadable logs are left out. Raises
    ScenarioError if there are no others, ViewerError, and MissingExtraError.
    """
    require("browse --catalog", "catalog", "rerun", "datafusion")
    if option.sink not in {"spawn", "serve"}:
        raise ViewerError("browse --catalog: give --spawn or --serve")
    if option.sink == "spawn":
        require_display()
    from transport.picture.comparison.catalog import serve_catalog, shown  # noqa: PLC0415

    readable = [run for run in runs if run.outcome != UNREADABLE and run.faults != MISSING]
    if not readable:
        raise ScenarioError(["browse --catalog: there is no readable run to show"])
    with TemporaryDirectory(prefix="convoy-") as folder:
        entries = []
        for number, run in enumerate(readable, 1):
            if until():
                return
            entries.append(_drawn(run, Path(folder) / f"{number}.rrd", report))
            report(f"{number} of {len(readable)} runs are drawn")
        with serve_catalog(DATASET, entries, _layout_of(readable)) as url, shown(url, option) as at:
            wait(url, at)


def _drawn(run: ListedRun, recording: Path, report: Callable[[str], None]) -> "CatalogEntry":
    from transport.picture.comparison.catalog import CatalogEntry  # noqa: PLC0415

    log = log_in(Path(run.log))
    review(log, RerunOption("save", target=str(recording)), wait=lambda _: None, warn=report)
    return CatalogEntry(recording, recording_id(log), _figures(run))


def _figures(run: ListedRun) -> dict[str, str | int | float]:
    """Figures of a run, without unknown ones."""
    figures = {
        "scenario": run.scenario,
        "overrides": " ".join(run.overrides),
        "seed": run.seed,
        "outcome": run.outcome,
        "worst_error_m": run.worst_error_m,
        "worst_vehicle": run.worst_vehicle,
        "events": run.events,
    }
    return {name: value for name, value in figures.items() if value is not None}


def _layout_of(runs: Sequence[ListedRun]) -> "CatalogLayout | None":
    """Layout for the run with most vehicles; None if no log holds its scenario."""
    from transport.picture.comparison.catalog import CatalogLayout  # noqa: PLC0415

    scenarios: list[Scenario] = []
    for run in runs:
        try:
            scenarios.append(scenario_of(log_in(Path(run.log))))
        except ConvoyError:
            continue
    if not scenarios:
        return None
    largest = max(scenarios, key=lambda scenario: len(scenario.vehicle_names))
    path = largest.route.path
    return CatalogLayout(
        largest.vehicle_names,
        widest_spacing(largest),
        (path.east.tolist(), path.north.tolist()),
        max(scenario.duration_s for scenario in scenarios),
    )
