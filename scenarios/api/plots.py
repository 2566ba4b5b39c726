"""The plots of a run and of a comparison. They need Matplotlib."""

import io
from collections.abc import Sequence
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.results.run_record import RunRecord, VehicleRecord
from scenarios.studies.comparison.comparison_figure import comparison_figure
from scenarios.studies.comparison.run_comparison import RunComparison
from scenarios.studies.picture_style import PAGE_IN, SEQUENCE, STYLE


class NotebookFigure(Figure):
    """A figure that notebooks show without pyplot."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


@mpl.rc_context(STYLE)
def run_figure(run: RunRecord, vehicles: Sequence[VehicleRecord]) -> Figure:
    """Draw paths, true errors, true gaps and speeds of vehicles; the lead is the darkest."""
    figure = NotebookFigure(figsize=(PAGE_IN, 4.4), layout="constrained")
    (paths, errors), (speeds, gaps) = figure.subplots(2, 2)
    names = list(run.vehicles)
    colours = mpl.colormaps[SEQUENCE](np.linspace(0.0, 0.9, len(names)))
    for vehicle in vehicles:
        true = vehicle.true
        line: dict[str, Any] = {"color": colours[names.index(vehicle.name)], "linewidth": 1.1}
        paths.plot(true.east_m, true.north_m, label=vehicle.name, **line)
        speeds.plot(true.t_s, true.speed_mps, **line)
        _plot_known(errors, true.t_s, true.error_m, line)
        _plot_known(gaps, true.t_s, true.gap_m, line)
    paths.set(xlabel="east, m", ylabel="north, m")
    paths.set_aspect("equal", adjustable="datalim")
    errors.set(xlabel="time, s", ylabel="true error, m (left positive)")
    speeds.set(xlabel="time, s", ylabel="speed, m/s")
    gaps.set(xlabel="time, s", ylabel="true gap, m")
    figure.legend(loc="outside right upper")
    figure.suptitle(fill(run.summary.identity.title or run.summary.identity.scenario, 90))
    return figure


def comparison_plot(comparison: RunComparison, vehicles: Sequence[str]) -> Figure:
    return comparison_figure(comparison, vehicles, NotebookFigure)


def _plot_known(axes: Axes, times: Any, values: Any, line: dict[str, Any]) -> None:
    """Plot a figure of a follower; the lead has none."""
    if np.isfinite(values).any():
        axes.plot(times, values, **line)
