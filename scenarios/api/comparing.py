"""Compare recorded runs."""

from collections.abc import Sequence
from dataclasses import asdict, fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.results.data_table import DataTable
from scenarios.results.run_record import RunRecord
from scenarios.studies.comparison.metrics import MetricDifference
from scenarios.studies.comparison.road import POSITION_COLUMNS
from scenarios.studies.comparison.runs import (
    APART_M,
    TOLERANCE,
    RunComparison,
    RunGroup,
    compare_runs,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AnyRun = str | Path | RunRecord
"""The folder of a run, its log, or an opened run."""
METRIC_COLUMNS = [field.name for field in fields(MetricDifference)]


class ComparedRuns:
    """Differences of runs, or of groups of runs, from the first one, A.

    `is_equal` and `sentence` are the result. `settings` has a row per differing setting, `metrics`
    one per differing metric, with its 99 % interval if a group has several runs, and `positions`
    one per vehicle and run: where it leaves its place in A, and its largest lateral difference at
    the same place. `runs` has the groups by label; `runs["B"].vehicles["v2"].station_m` and
    `offset_m` are places along the path of A and offsets to its left at each true pose. `faults`
    describe damage and holes of the logs.
    """

    def __init__(self, comparison: RunComparison) -> None:
        self._comparison = comparison
        self.is_equal, self.faults = comparison.is_equal, comparison.faults
        self.sentence = comparison.sentence
        self.runs: dict[str, RunGroup] = {group.label: group for group in comparison.groups}
        settings = comparison.settings.items()
        rows = [{"key": key} | dict(zip(self.runs, texts, strict=True)) for key, texts in settings]
        self.settings = DataTable.of_rows(rows, ("key", *self.runs))
        metrics = [asdict(row) for row in comparison.metrics]
        self.metrics = DataTable.of_rows(metrics, METRIC_COLUMNS)
        positions = [one.row() for one in comparison.positions]
        self.positions = DataTable.of_rows(positions, POSITION_COLUMNS)

    def plot(self, vehicles: Sequence[str] = ()) -> "Figure":
        """Draw errors, differences, gaps and modes over time and place.

        By default of the four followers that differ most.
        """
        from scenarios.studies.comparison.figure import comparison_figure  # noqa: PLC0415 - slow

        return comparison_figure(self._comparison, vehicles)

    def __repr__(self) -> str:
        return f"<ComparedRuns {', '.join(self.runs)}: {self.sentence}>"

    def _repr_html_(self) -> str:
        lines = [*(run.title for run in self.runs.values()), self.sentence, *self.faults]
        tables = [table for table in (self.settings, self.metrics, self.positions) if len(table)]
        paragraphs = "".join(f"<p>{escape(line)}</p>" for line in lines)
        return paragraphs + "".join(table._repr_html_() for table in tables)


def compare(*runs: AnyRun, tolerance: float = TOLERANCE, apart_m: float = APART_M) -> ComparedRuns:
    """Compare two or more runs, like `convoy compare`.

    Args:
        runs: Runs, their folders or logs, or folders of runs of one setting, such as one per seed;
            the first one is A. Several runs a setting are compared with the noise over the seeds,
            which needs SciPy.
        tolerance: Difference of metrics, relative to their size, that is none.
        apart_m: Difference of the lateral positions from which vehicles part.

    Raises:
        Error: A log cannot be read or lacks what is compared.

    """
    paths = [run.log if isinstance(run, RunRecord) else Path(run) for run in runs]
    return ComparedRuns(compare_runs(paths, tolerance, apart_m))
