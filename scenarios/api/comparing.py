"""Compare recorded runs."""

from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.definition.errors import require
from scenarios.results.data_table import DataTable
from scenarios.results.run_record import RunRecord
from scenarios.results.vehicle_figures import STRING_COLUMNS
from scenarios.studies.comparison.run_comparison import (
    TOLERANCE_M,
    ComparedRun,
    RunComparison,
    compare_runs,
)
from scenarios.studies.comparison.run_diff import RunDiff, diff_runs

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure
import warnings
from collections.abc import Callable
from tempfile import TemporaryDirectory

from scenarios.api.recorded import Run
from scenarios.api.running import Settings, overrides_of, run_loaded
from scenarios.results.log_info import replayed_session
from scenarios.results.log_summary import log_in
from scenarios.results.summary import ClockName

AnyRun = str | Path | RunRecord
"""The folder of a run, its log, or an opened run."""
SETTING_COLUMNS = ("key", "a", "b")
FIGURE_COLUMNS = ("name", "a", "b", "difference", "low", "high", "exceeds_noise")
DIFFERENCE_COLUMNS = (
    *("label", "vehicle", "diverges_at_m", "diverges_at_s"),
    *("difference_m_max", "difference_at_m"),
)


class Diff:
    """Differences of two runs A and B, or of the runs in two folders.

    `is_equal` and `sentence` are the result. `settings` has a row per differing setting, `figures`
    one per differing figure, with its 99 % interval if several runs a side are given. `faults`
    describe damage and holes of the logs.
    """

    def __init__(self, diff: RunDiff) -> None:
        self.is_equal, self.sentence, self.faults = diff.is_equal, diff.sentence, diff.faults
        self.settings = DataTable.of_rows([asdict(row) for row in diff.settings], SETTING_COLUMNS)
        self.figures = DataTable.of_rows(
            [{name: getattr(row, name) for name in FIGURE_COLUMNS} for row in diff.figures],
            FIGURE_COLUMNS,
        )

    def __repr__(self) -> str:
        return f"<Diff: {self.sentence}>"

    def _repr_html_(self) -> str:
        lines = [self.sentence, *self.faults]
        tables = [table._repr_html_() for table in (self.settings, self.figures) if len(table)]
        return "".join([*(f"<p>{escape(line)}</p>" for line in lines), *tables])


class ComparedRuns:
    """Several runs on the path of the first one, A.

    `runs` has them by label; `runs["B"].vehicles["v2"].station_m` and `offset_m` are places along
    the path of A and offsets to its left at each true pose. `differences` has a row per vehicle and
    run: where it leaves its place in A, and its largest lateral difference at the same place.
    `string_errors` has a row per follower and run: its errors, and their gains from the vehicle
    ahead and from the head of the string. `sentence` describes the first divergence; `faults`
    describe damage and holes of the logs.
    """

    def __init__(self, comparison: RunComparison) -> None:
        self._comparison = comparison
        self.tolerance_m, self.faults = comparison.tolerance_m, comparison.faults
        self.sentence = comparison.sentence
        self.runs: dict[str, ComparedRun] = {run.label: run for run in comparison.runs}
        self.differences = DataTable.of_rows(list(comparison.rows()), DIFFERENCE_COLUMNS)
        self.string_errors = DataTable.of_rows(
            [
                {"label": run.label} | row.row()
                for run in comparison.runs
                for row in run.string_errors
            ],
            ("label", *STRING_COLUMNS),
        )

    def plot(self, vehicles: Sequence[str] = ()) -> "Figure":
        """Draw errors, differences, gaps and modes over time and place, and errors of the string.

        By default with the four followers that differ most. Raises Error without Matplotlib.
        """
        require("plot", "studies", "matplotlib")
        from scenarios.api.plots import comparison_plot  # noqa: PLC0415 - an extra

        return comparison_plot(self._comparison, vehicles)

    def __repr__(self) -> str:
        return f"<ComparedRuns {', '.join(self.runs)}: {self.sentence}>"

    def _repr_html_(self) -> str:
        lines = [*(run.title for run in self.runs.values()), self.sentence, *self.faults]
        paragraphs = "".join(f"<p>{escape(line)}</p>" for line in lines)
        return paragraphs + self.differences._repr_html_()


def diff(a: AnyRun, b: AnyRun) -> Diff:
    """List the differences of two runs, like `convoy diff`.

    Args:
        a: A run, its folder or log, or a folder of several runs, such as one per seed.
        b: The same; with several runs a side only figures are compared, against the noise over the
            seeds, which needs SciPy.

    Raises:
        Error: A log cannot be read, or one side has only one run.

    """
    return Diff(diff_runs(path_of(a), path_of(b)))


def compare(*runs: AnyRun, tolerance_m: float = TOLERANCE_M) -> ComparedRuns:
    """Compare two or more runs by place and time, like `convoy compare`.

    Args:
        runs: Runs, their folders or logs; the first one is A.
        tolerance_m: Difference of the lateral positions from which runs diverge.

    Raises:
        Error: A log cannot be read or lacks what is compared.

    """
    return ComparedRuns(compare_runs([path_of(run) for run in runs], tolerance_m))


def path_of(run: AnyRun) -> Path:
    return run.log if isinstance(run, RunRecord) else Path(run)


# ---- Run again from a log


def replay(
    log: AnyRun,
    vehicles: Sequence[str],
    *,
    set: Settings | None = None,  # noqa: A002 - as on the command line
    seed: int | None = None,
    clock: ClockName = "virtual",
    out: str | Path | None = None,
    partial: bool = False,
    confirmed: bool = False,
    report: Callable[[str], None] | None = None,
) -> Run:
    """Let recorded `vehicles` send their messages again, and simulate the others behind them.

    Like `convoy replay`; `partial` allows a damaged or incomplete log. The other arguments are
    those of `run`. Raises Error for an invalid log, vehicle or setting.
    """
    scenario = replayed_session(
        log_in(path_of(log)), vehicles, overrides_of(set), seed, warn=warnings.warn, partial=partial
    )
    with TemporaryDirectory(prefix="convoy-") as folder:
        file = Path(folder, f"{scenario.name}.toml")
        file.write_text(scenario.text, encoding="utf-8")
        return run_loaded(
            scenario, [str(file)], clock=clock, out=out, confirmed=confirmed, report=report
        )
