"""Plot of cuts: errors of followers, and the distance driven blind. Needs matplotlib."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.studies.cuts.cut import CutFigures
from scenarios.studies.picture_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, RED, STYLE
from vehicles.driver.degradation.settings import Reaction

COLOURS: Mapping[Reaction, str] = {
    "degrade": BLUE,
    "extrapolate": ORANGE,
    "hold": RED,
    "straight": GREEN,
}
LEAST_M = 0.003
"""Smaller errors are drawn here."""
HALF_LANE_M = 0.82
"""A car 1.86 m wide leaves a lane of 3.5 m this far from its middle."""
EDGE: Any = {"color": GREY, "linewidth": 0.9, "linestyle": ":"}


@mpl.rc_context(STYLE)
def drawn_figure(rows: Mapping[Reaction, Sequence[CutFigures]]) -> Figure:
    """Draw the errors of all reactions, errors over speed, and blind metres of `degrade`."""
    figure = Figure(figsize=(PAGE_IN, 2.9), layout="constrained")
    errors, speeds, blind = figure.subplots(1, 3)
    for reaction, of in rows.items():
        _errors(errors, reaction, of)
        at_speed = [row.cut.speed_mps for row in of]
        error = [max(row.error, LEAST_M) for row in of]
        speeds.plot(at_speed, error, ".", color=COLOURS[reaction], markersize=2.5, alpha=0.6)
    errors.axvline(HALF_LANE_M, label="edge of the lane", **EDGE)
    errors.set(xscale="log", xlabel="largest true error, m", ylabel="share of followers, %")
    errors.set_ylim(0.0, 102.0)
    errors.xaxis.set_major_formatter("{x:g}")
    speeds.axhline(HALF_LANE_M, **EDGE)
    speeds.set(yscale="log", xlabel="speed, m/s", ylabel="largest true error, m")
    speeds.yaxis.set_major_formatter("{x:g}")
    _blind(blind, rows["degrade"])
    figure.legend(*errors.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return figure


def _errors(axes: Axes, reaction: Reaction, rows: Sequence[CutFigures]) -> None:
    values = np.sort([max(row.error, LEAST_M) for row in rows])
    shares = 100.0 * np.arange(1, len(values) + 1) / len(values)
    axes.step(values, shares, where="post", color=COLOURS[reaction], label=reaction)


def _blind(axes: Axes, rows: Sequence[CutFigures]) -> None:
    stopped = [row for row in rows if row.stopped]
    predicted = [row.predicted_blind for row in stopped]
    farthest = max([1.0, *predicted, *(row.blind for row in stopped)])
    axes.plot([0.0, farthest], [0.0, farthest], color=GREY, linewidth=0.9)
    axes.plot(predicted, [row.blind for row in stopped], ".", color=BLUE, markersize=3.0)
    axes.set(xlabel="predicted blind distance, m", ylabel="blind distance of degrade, m")
