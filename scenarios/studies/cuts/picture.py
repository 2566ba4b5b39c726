"""The picture of cuts: how far followers stray, and how far they drive blind. Needs matplotlib."""

from collections.abc import Mapping, Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.studies.cuts.cut import CutFigures
from scenarios.studies.picture_style import BLUE, GREEN, GREY, ORANGE, RED, STYLE
from vehicles.driver.degradation.settings import Reaction

COLOURS: Mapping[Reaction, str] = {
    "degrade": BLUE,
    "extrapolate": ORANGE,
    "hold": RED,
    "straight": GREEN,
}
LEAST_M = 0.003
"""Errors below are drawn here."""
HALF_LANE_M = 0.82
"""A car 1.86 m wide leaves a lane of 3.5 m when it is so far from its middle."""


@mpl.rc_context(STYLE)
def drawn_figure(rows: Mapping[Reaction, Sequence[CutFigures]]) -> Figure:
    """Draw the errors of all reactions, errors over speed, and blind metres of `degrade`."""
    figure = Figure(figsize=(10.5, 3.6), layout="constrained")
    errors, speeds, blind = figure.subplots(1, 3)
    for reaction, of in rows.items():
        _errors(errors, reaction, of)
        at_speed = [row.cut.speed_mps for row in of]
        error = [max(row.error, LEAST_M) for row in of]
        speeds.plot(at_speed, error, ".", color=COLOURS[reaction], markersize=2.0, alpha=0.5)
    _describe(errors, speeds)
    _blind(blind, rows["degrade"])
    return figure


def _errors(axes: Axes, reaction: Reaction, rows: Sequence[CutFigures]) -> None:
    values = np.sort([max(row.error, LEAST_M) for row in rows])
    shares = np.arange(1, len(values) + 1) / len(values)
    axes.step(values, shares, where="post", color=COLOURS[reaction], label=reaction)


def _describe(errors: Axes, speeds: Axes) -> None:
    errors.axvline(HALF_LANE_M, color=GREY, linewidth=0.9, linestyle=":")
    errors.set(xscale="log", xlabel="largest true error while nothing came, m")
    errors.set_ylabel("share of the cuts")
    errors.legend(loc="lower right")
    speeds.axhline(HALF_LANE_M, color=GREY, linewidth=0.9, linestyle=":")
    speeds.text(8.0, 1.1 * HALF_LANE_M, "edge of the lane", color=GREY, fontsize=7.5)
    speeds.set(yscale="log", xlabel="speed, m/s", ylabel="largest true error, m")


def _blind(axes: Axes, rows: Sequence[CutFigures]) -> None:
    stopped = [row for row in rows if row.stopped]
    predicted = [row.predicted_blind for row in stopped]
    farthest = max([1.0, *predicted, *(row.blind for row in stopped)])
    axes.plot([0.0, farthest], [0.0, farthest], color=GREY, linewidth=0.9)
    axes.plot(predicted, [row.blind for row in stopped], ".", color=BLUE, markersize=3.0)
    axes.set(xlabel="blind metres as predicted", ylabel="blind metres driven")
