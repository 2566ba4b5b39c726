"""Draw the lines of a figure with their intervals. Needs Matplotlib."""

from math import isfinite
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from scenarios.studies.figures.study import FigurePanel, FigurePoint, FigureResult
from scenarios.studies.picture_style import (
    BLUE,
    COLUMN_IN,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    PURPLE,
    RED,
    SKY,
    STYLE,
)

COLOURS = (RED, BLUE, GREEN, ORANGE, PURPLE, SKY, GREY)
MARKERS = "osD^vPX"
PANEL_HEIGHT_IN = 2.5
SHIFT_RATIO = 0.008
"""Shift of a line from the next one, relative to the x axis, so that intervals do not overlap."""
ROOM = 1.6
"""Factor between the outermost mean and the end of a logarithmic axis; intervals may be cut off."""


@mpl.rc_context(STYLE)
def drawn(result: FigureResult) -> Figure:
    """Draw all panels, two in a row; those of a row with the same quantity share their y axis."""
    panels = result.study.panels
    columns = min(len(panels), 2 if len(panels) != 6 else 3)
    rows = -(-len(panels) // columns)
    figure = Figure(
        figsize=(PAGE_IN if columns > 1 else COLUMN_IN, rows * PANEL_HEIGHT_IN + 0.7),
        layout="constrained",
    )
    labels = [panel.y_label for panel in panels]
    is_shared = all(label == labels[n - n % columns] for n, label in enumerate(labels))
    sharing: Any = "row" if is_shared else "none"
    places = list(figure.subplots(rows, columns, squeeze=False, sharey=sharing).flat)
    for place in places[len(panels) :]:
        place.set_axis_off()
    names = list(dict.fromkeys(one.series for one in result.points))
    for number, (place, panel) in enumerate(zip(places, panels, strict=False)):
        own = [one for one in result.points if one.panel == number]
        _draw(place, panel, own, names)
        if panel.is_log:
            alike = [one for one in result.points if panels[one.panel].y_label == panel.y_label]
            bounds = [] if panel.bound is None else [panel.bound]
            _scale_logarithmic(place, [*bounds, *(one.mean for one in alike if one.mean)])
        if number % columns and is_shared:
            place.set_ylabel("")
    lines = [place.get_legend_handles_labels() for place in places[: len(panels)]]
    entries = {name: line for of_place in lines for line, name in zip(*of_place, strict=True)}
    if all(set(of_place[1]) == set(entries) for of_place in lines):
        figure.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=3)
    else:
        for place in places[: len(panels)]:
            place.legend()
    figure.suptitle(f"{result.study.title}; mean and 95 % interval")
    return figure


def _draw(place: Axes, panel: FigurePanel, points: list[FigurePoint], names: list[str]) -> None:
    own = [name for name in names if any(one.series == name for one in points)]
    is_shared = len(own) == len(names)
    places = [one.x for one in points]
    reach = SHIFT_RATIO * (max(places, default=0.0) - min(places, default=0.0))
    for name in own:
        number = (names if is_shared else own).index(name)
        known = [one for one in points if one.series == name and one.mean is not None]
        x = np.array([one.x for one in known]) + reach * (number - 0.5 * (len(own) - 1))
        mean, low, high = (
            np.array([_shown(getattr(one, end), one.mean) for one in known])
            for end in ("mean", "low", "high")
        )
        style: dict[str, Any] = {"color": COLOURS[number % len(COLOURS)]}
        place.plot(x, mean, marker=MARKERS[number % len(MARKERS)], markersize=3.5, label=name,
                   **style)  # fmt: skip
        place.errorbar(x, mean, yerr=[mean - low, high - mean], fmt="none", elinewidth=0.9,
                       capsize=2.0, alpha=0.7, **style)  # fmt: skip
    if panel.bound is not None:
        place.axhline(panel.bound, color="black", linewidth=0.8, linestyle=":")
    if not panel.is_log:
        place.set_ylim(bottom=0.0)
    if panel.x_label == "vehicle":
        place.xaxis.set_major_locator(MaxNLocator(integer=True))
    place.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)


def _scale_logarithmic(place: Axes, values: list[float]) -> None:
    """Make the y axis logarithmic, so that it shows all `values`."""
    least, most = min(values, default=1.0) / ROOM, max(values, default=1.0) * ROOM
    place.set_yscale("log")
    place.set_ylim(least, most)
    place.yaxis.set_major_formatter(FuncFormatter(_plain))
    place.yaxis.set_minor_formatter(FuncFormatter(_plain) if most < 50.0 * least else "")


def _plain(value: float, _place: object) -> str:
    """A tick of a logarithmic axis, if it is 1, 2 or 5 times a power of ten."""
    return f"{value:g}" if f"{value:e}"[0] in "125" else ""


def _shown(value: float | None, mean: float | None) -> float:
    """A value, or the mean where it has no interval."""
    known = mean if value is None or not isfinite(value) else value
    return float("nan") if known is None else known
