"""Open recorded runs."""

from collections.abc import Sequence
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.results.data_table import DataTable
from scenarios.results.frequency_gains import SignalName, frequency_gains
from scenarios.results.log_summary import summary_of
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from scenarios.results.table_files import FileFormat, export_run
from scenarios.results.vehicle_figures import STRING_COLUMNS, VehicleSummary, string_rows
from scenarios.runs.run_folder import is_running
from scenarios.studies.run_list import COLUMNS, as_rows, runs_in, selected
from transport.log.errors import LogError

if TYPE_CHECKING:  # an extra
    from matplotlib.figure import Figure

HEADINGS = (
    "vehicle",
    "largest true error, m",
    "rms true error, m",
    "smallest true gap, m",
    "largest true gap, m",
    "distance, m",
)


class Run(RunRecord):
    """A recorded run.

    - `run.summary`: its figures, as in `summary.json`.
    - `run.vehicles["v4"]`: its tables `true`, `gps`, `tracking`, `command`, `trajectory`,
      `verdict` and `health`.
    - `run.links["v1", "v3"].outcomes`: the outcome of each sent message.
    - `run.states`, `run.messages`: all vehicles in one table, and all links in another.
    - `run.texts`: lines of text.
    - `run.tables`: the messages of which metrics are made; functions of them give every metric.
    - `run.scenario`, `run.log`, `run.faults`: its scenario, the path of the log, and damage or
      holes of the log in a line. `run.origin` describes the log by name and value, as in exported
      files.

    A column of a table is a NumPy array: `run.vehicles["v4"].true.error_m`. The first columns are
    the time `t_s` (s) after the start and the instant `at_ns` (ns, Unix time).
    """

    @cached_property
    def summary(self) -> RunSummary:
        """Figures of the run, as in `summary.json`.

        Those of an incomplete log, and of a run that still runs, are computed from its messages.
        """
        return summary_of(self.log, running=is_running(self.log))

    def plot(self, vehicles: Sequence[str] | None = None) -> "Figure":
        """Draw paths, true errors, gaps and speeds, by default of all vehicles in the log.

        Returns a Matplotlib figure. Raises Error without true poses.
        """
        from scenarios.results.run_figures import (  # noqa: PLC0415 - slow to import
            run_figure,
            vehicles_with_truth,
        )

        names = [self.vehicles[name].name for name in vehicles or vehicles_with_truth(self)]
        if not names:
            raise LogError(f"{self.log}: holds no true poses of a vehicle")
        return run_figure(self, names)

    @cached_property
    def string_errors(self) -> DataTable:
        """String stability figures: a row per follower, in the order of the convoy.

        Errors, and their L2 and L∞ gains from the vehicle ahead and from the head of the string:
        above 1 the error grows. See `convoy reference string-stability`.
        """
        return DataTable.of_rows(string_rows(self.summary.vehicles), STRING_COLUMNS)

    def frequency_gains(self, signal: SignalName = "speed") -> DataTable:
        """Gains of each follower from the vehicle ahead by frequency, where that is excited.

        With columns `frequency_hz`, `gain` and its 95 % interval `low` to `high`, `phase_rad` and
        `coherence`. The `signal` is "speed" or "spacing" (spacing errors of followers that keep a
        gap). The table is empty without excitation, such as by a lead that brakes.
        """
        return frequency_gains(self.tables, signal)

    def report(self, path: str | Path) -> Path:
        """Write tables, pictures and definitions into one HTML file, like `convoy report --html`.

        An existing file is replaced. Returns its path.
        """
        from scenarios.results.report.page import write_report  # noqa: PLC0415 - slow to import

        write_report(self, Path(path), self.summary)
        return Path(path)

    def export(self, out: str | Path, formats: Sequence[FileFormat] = ("csv", "gpx")) -> list[Path]:
        """Write tables and tracks into a folder, like `convoy export`; returns their paths.

        The formats are "csv" and "parquet", each with the files `vehicles` and `links`, and "gpx"
        with a track of the measured positions of each vehicle. They state their log and its faults,
        CSV files in `export.json` next to them. Raises Error if a file exists.
        """
        return export_run(self, Path(out), formats)

    def __repr__(self) -> str:
        return f"<Run {self.log}: {self.summary.outcome_line or self.summary.outcome}>"

    def _repr_html_(self) -> str:
        """Show the outcome and the figures of each vehicle in a notebook."""
        summary = self.summary
        head = "".join(f"<th>{heading}</th>" for heading in HEADINGS)
        rows = "".join(f"<tr>{_row(vehicle)}</tr>" for vehicle in summary.vehicles)
        title = escape(summary.identity.title or summary.identity.scenario)
        line = escape(summary.outcome_line or summary.outcome)
        faults = f"<p>{escape(summary.log_faults)}</p>" if summary.log_faults else ""
        return f"<p><b>{title}</b><br>{line}</p>{faults}<table><tr>{head}</tr>{rows}</table>"


def open(path: str | Path) -> Run:  # noqa: A001 - as convoy.open
    """Open the folder of a run, or a log.

    The log may be incomplete or damaged, see `Run.faults`. Tables are read when they are used.
    Raises Error if it is not the log of a run.
    """
    return Run(path)


def runs(folder: str | Path = "runs", where: Sequence[str] = (), sort: str = "") -> DataTable:
    """List the runs in a folder, like `convoy runs`; the column `log` opens one.

    Args:
        folder: It is searched for logs, in its folders too.
        where: Conditions that the runs must meet, such as "outcome=failed" or "worst_error_m>0.5".
        sort: A column, or "-COLUMN" for descending order.

    Raises:
        Error: The folder holds no logs, or a column does not exist.

    """
    selected((), where, sort)  # refuse these before the logs are read
    return DataTable.of_rows(as_rows(selected(runs_in(Path(folder)), where, sort)), COLUMNS)


def _row(vehicle: VehicleSummary) -> str:
    figures = (
        vehicle.cross_track_error_m_max,
        vehicle.cross_track_error_m_rms,
        vehicle.true_gap_m_min,
        vehicle.true_gap_m_max,
        vehicle.distance_m,
    )
    cells = [escape(vehicle.name), *("-" if value is None else f"{value:.3g}" for value in figures)]
    return "".join(f"<td>{cell}</td>" for cell in cells)
