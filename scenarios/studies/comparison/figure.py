"""A figure of several runs: errors, differences, gaps and modes over time and path length."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from scenarios.results.figure_style import (
    MODE_COLOURS,
    PAGE_IN,
    STYLE,
    vehicle_colour,
    write_picture,
)
from scenarios.results.run_figures import ModeStrip, NotebookFigure, draw_curve, draw_strips
from scenarios.studies.comparison.road import PlacedVehicle
from scenarios.studies.comparison.runs import RunComparison, RunGroup
from transport.log.errors import LogError

MOST_SHOWN = 4
"""Followers with curves by default, those that differ most."""
LINES: Sequence[Any] = ("-", (0, (4, 1.5)), ":", "-.")
"""Line styles of the runs; they repeat."""
STRIP_IN = 0.11
"""Height of a strip of modes."""
MARK: Any = {"color": "black", "linewidth": 0.8, "linestyle": (0, (1, 2))}
TITLE_WIDTH = 100
"""Characters of a line of the title of a run."""


def draw_comparison(comparison: RunComparison, path: Path, vehicles: Sequence[str] = ()) -> None:
    """Draw a figure into a new file, PNG, SVG or PDF by its extension.

    Raises FileExistsError, ScenarioError for another extension, or LogError for unknown vehicles.
    """
    write_picture(comparison_figure(comparison, vehicles), path)


@mpl.rc_context(STYLE)
def comparison_figure(comparison: RunComparison, vehicles: Sequence[str] = ()) -> Figure:
    """Draw the curves of `vehicles`, by default of the followers that differ most.

    Raises LogError for vehicles that the first run of A does not hold.
    """
    first = comparison.groups[0]
    if unknown := [name for name in vehicles if name not in first.vehicles]:
        known = ", ".join(first.vehicles)
        raise LogError(f"{first.record.log}: holds no vehicle {', '.join(unknown)}; it has {known}")
    shown = list(vehicles) or most_different(comparison)
    strips = STRIP_IN * len(shown) * len(comparison.groups) + 0.3
    heights = (1.45, 1.2, 1.2, strips)
    figure = NotebookFigure(figsize=(PAGE_IN, sum(heights) + 1.6), layout="constrained")
    rows = figure.subplots(len(heights), 2, height_ratios=heights, sharex="col")
    for column, label in enumerate(("time, s", "distance along the path of A, m")):
        _draw_column(rows[:, column], comparison, shown, over_time=column == 0)
        rows[3, column].set_xlabel(label)
    others = ", ".join(group.label for group in comparison.groups[1:])
    for axes, title, label in (
        (rows[0, 0], "error from the lead's path, left positive", "error, m"),
        (rows[1, 0], f"offset of {others} minus that of A at the same place", "difference, m"),
        (rows[2, 0], "gap to the vehicle ahead, bumper to bumper", "gap, m"),
        (rows[3, 0], "modes", ""),
    ):
        axes.set_title(title, loc="left")
        axes.set_ylabel(label)
    figure.legend(handles=list(_run_handles(comparison)), loc="outside upper left")
    handles = list(_vehicle_handles(comparison, shown))
    figure.legend(handles=handles, loc="outside lower center", ncols=5)
    return figure


def most_different(comparison: RunComparison) -> list[str]:
    """Followers that differ most, in the order of the convoy; the lead if it drives alone."""
    lead, *followers = comparison.groups[0].vehicles
    largest = dict.fromkeys(followers, 0.0)
    for one in comparison.positions:
        if one.vehicle in largest and (row := one.largest) is not None:
            largest[one.vehicle] = max(largest[one.vehicle], abs(float(one.offset_m[row])))
    worst = sorted(followers, key=lambda name: -largest[name])[:MOST_SHOWN]
    return [name for name in followers if name in worst] or [lead]


def _draw_column(
    rows: Sequence[Axes], comparison: RunComparison, shown: Sequence[str], *, over_time: bool
) -> None:
    errors, differences, gaps, modes = rows
    styles = {
        (group.label, name): {
            "color": colour,
            "linestyle": LINES[number % len(LINES)],
            "linewidth": 1.0 if number else 1.3,
            "alpha": 1.0 if number else 0.55,
        }
        for number, group in enumerate(comparison.groups)
        for name, colour in _colours(comparison, shown).items()
    }
    strips, places = [], []
    for group, vehicle in _shown(comparison, shown):
        style, true = styles[group.label, vehicle.name], vehicle.true
        along = true.t_s if over_time else vehicle.station_m
        draw_curve(errors, (along, true.error_m), **style)
        draw_curve(gaps, (along, true.gap_m), **style)
        places.append(along)
        edges = np.array([*(change.at_s for change in vehicle.modes), true.t_s[-1]])
        edges = edges if over_time else vehicle.station_at(np.maximum(edges, true.t_s[0]))
        names = [change.mode for change in vehicle.modes]
        strips.append(ModeStrip(f"{vehicle.name} {group.label}", edges.tolist(), names))
    everywhere = np.concatenate(places)  # NaN beside another road
    draw_strips(modes, strips, (np.fmin.reduce(everywhere), np.fmax.reduce(everywhere)))
    for one in comparison.positions:
        if one.vehicle in shown:
            along = one.at_s if over_time else one.station_m
            draw_curve(differences, (along, one.offset_m), **styles[one.label, one.vehicle])
    first = comparison.first
    if first is not None and first.parts is not None:
        along = first.at_s if over_time else first.station_m
        for axes in rows:
            axes.axvline(float(along[first.parts]), **MARK)


def _colours(comparison: RunComparison, shown: Sequence[str]) -> dict[str, str]:
    convoy = list(comparison.groups[0].vehicles)
    return {name: vehicle_colour(convoy.index(name)) for name in shown}


def _shown(
    comparison: RunComparison, shown: Sequence[str]
) -> Iterator[tuple[RunGroup, PlacedVehicle]]:
    for name in shown:
        for group in comparison.groups:
            if name in group.vehicles:
                yield group, group.vehicles[name]


def _run_handles(comparison: RunComparison) -> Iterator[Line2D]:
    for number, group in enumerate(comparison.groups):
        label = fill(group.title, TITLE_WIDTH, subsequent_indent="   ")
        line = LINES[number % len(LINES)]
        yield Line2D([], [], label=label, linestyle=line, color="0.0" if number else "0.65")


def _vehicle_handles(comparison: RunComparison, shown: Sequence[str]) -> Iterator[Line2D | Patch]:
    """Entries of the legend: vehicles, the first divergence, modes that occur."""
    for name, colour in _colours(comparison, shown).items():
        yield Line2D([], [], color=colour, label=name)
    if comparison.first:
        yield Line2D([], [], label="first divergence", **MARK)
    used = {change.mode for _, one in _shown(comparison, shown) for change in one.modes}
    for mode, colour in MODE_COLOURS.items():
        if mode in used:
            yield Patch(color=colour, label=f"mode {mode}")
