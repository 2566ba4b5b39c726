"""Plot of cuts: errors, runs that leave the lane or collide, blind distances. Needs matplotlib."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import inf
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.studies.cuts.cut import Variant
from scenarios.studies.cuts.cut_figures import CutFigures
from scenarios.studies.cuts.run_figures import RunFigures, figures_of_runs
from scenarios.studies.picture_style import BLUE, GREEN, GREY, ORANGE, PAGE_IN, RED, STYLE

COLOURS: Mapping[Variant, str] = {
    "degrade": BLUE,
    "extrapolate": ORANGE,
    "hold": RED,
    "straight": GREEN,
    "history": BLUE,
    "no_history": ORANGE,
}
LABELS: Mapping[str, str] = {
    "history": "with path history",
    "no_history": "without path history",
}
LEAST_M = 0.01
"""Smaller errors are drawn here."""
HALF_LANE_M = 0.82
"""A car 1.86 m wide leaves a lane of 3.5 m this far from its middle."""
LENGTHS_S = 0.2, 1.0, 2.0, 4.0, 6.0, 8.0, inf
"""Edges of the classes of cuts by length; the last class is permanent cuts."""
EDGE: Any = {"color": GREY, "linewidth": 0.9, "linestyle": ":"}


@mpl.rc_context(STYLE)
def drawn_figure(rows: Mapping[Variant, Sequence[CutFigures]]) -> Figure:
    """Draw errors, runs that leave the lane or collide, and blind distances of all variants."""
    figure = Figure(figsize=(PAGE_IN, 2.9), layout="constrained")
    errors, shares, blind = figure.subplots(1, 3)
    for variant, of in rows.items():
        runs = figures_of_runs(of)
        _errors(errors, variant, runs)
        _share(shares, runs, lambda run: run.departures > 0, color=COLOURS[variant])
        _share(shares, runs, lambda run: run.collisions > 0, color=COLOURS[variant], ls="--")
        ended = [run for run in runs if run.cut.for_s is not None]
        _share(shares, ended, lambda run: not run.resumed, color=COLOURS[variant], ls=":")
    errors.axvline(HALF_LANE_M, label="edge of a lane of 3.5 m", **EDGE)
    errors.set(xscale="log", xlabel="largest true error, m", ylabel="share of runs, %")
    errors.set_ylim(0.0, 102.0)
    errors.xaxis.set_major_formatter("{x:g}")
    names = [f"{short:g}–{long:g}" for short, long in pairwise(LENGTHS_S[:-1])]
    shares.set_xticks(range(len(names) + 1), [*names, "for\ngood"], fontsize=7.0)
    shares.set(xlabel="length of the cut, s", ylabel="share of runs, %")
    shares.set_ylim(0.0, 105.0)
    shares.plot([], [], color=GREY, label="left the lane")
    shares.plot([], [], color=GREY, ls="--", label="collided")
    shares.plot([], [], color=GREY, ls=":", label="a car did not resume")
    shares.legend(loc="upper left", fontsize=6.5)
    _blind(blind, rows)
    figure.legend(*errors.get_legend_handles_labels(), loc="outside upper center", ncols=5)
    return figure


def _errors(axes: Axes, variant: Variant, runs: Sequence[RunFigures]) -> None:
    values = np.sort([max(run.error, LEAST_M) for run in runs])
    shares = 100.0 * np.arange(1, len(values) + 1) / len(values)
    label = LABELS.get(variant, variant)
    axes.step(values, shares, where="post", color=COLOURS[variant], label=label)


def _share(
    axes: Axes, runs: Sequence[RunFigures], counts: Callable[[RunFigures], bool], **style: Any
) -> None:
    """Draw the share of runs that count, for each class of cuts with runs."""
    places, shares = [], []
    for place, (short, long) in enumerate(pairwise(LENGTHS_S)):
        group = [run for run in runs if short <= _length_s(run) < long]
        if group:
            places.append(place)
            shares.append(100.0 * sum(map(counts, group)) / len(group))
    axes.plot(places, shares, marker=".", **style)


def _length_s(run: RunFigures) -> float:
    return LENGTHS_S[-2] if run.cut.for_s is None else min(run.cut.for_s, LENGTHS_S[-2] - 1e-9)


def _blind(axes: Axes, rows: Mapping[Variant, Sequence[CutFigures]]) -> None:
    """Draw driven over predicted blind distances of stops to a standstill."""
    farthest = 1.0
    for variant, of in rows.items():
        stops = [(row.predicted_blind or 0.0, row.blind) for row in of if row.blind is not None]
        farthest = max([farthest, *(max(stop) for stop in stops)])
        predicted, driven = np.reshape(stops, (-1, 2)).T
        axes.plot(predicted, driven, ".", color=COLOURS[variant], markersize=3.0)
    axes.plot([0.0, farthest], [0.0, farthest], color=GREY, linewidth=0.9)
    axes.set(xlabel="predicted blind distance, m", ylabel="blind distance driven, m")
