"""A figure of several runs: errors, gaps and modes over time and path length, and by vehicle."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scenarios.results.files import write_whole
from scenarios.studies.comparison.run_comparison import (
    OffsetDifference,
    PlacedVehicle,
    RunComparison,
)
from scenarios.studies.picture_style import PAGE_IN, STYLE, encoded, picture_format_of
from transport.panels import PANELS, colour_of

Floats = NDArray[np.float64]
MOST_SHOWN = 4
"""Followers with curves by default, those that differ most."""
LINES: Sequence[Any] = ("-", (0, (4, 1.5)), ":", "-.")
"""Line styles of the runs; they repeat."""
STRIP_IN = 0.11
"""Height of a strip of modes."""
MARK: Any = {"color": "black", "linewidth": 0.8, "linestyle": (0, (1, 2))}
TITLE_WIDTH = 100
"""Characters of a line of the title of a run."""
TIME, PLACE = 0, 1


def draw_comparison(comparison: RunComparison, path: Path, vehicles: Sequence[str] = ()) -> None:
    """Draw a figure into a new file, PNG, SVG or PDF by its extension.

    Raises FileExistsError, or ScenarioError for another extension.
    """
    picture_format = picture_format_of(path)
    content = encoded(comparison_figure(comparison, vehicles), picture_format)
    write_whole(path, content, new=True)


@mpl.rc_context(STYLE)
def comparison_figure(
    comparison: RunComparison,
    vehicles: Sequence[str] = (),
    figure_class: type[Figure] = Figure,
) -> Figure:
    """Draw the curves of `vehicles`, by default of the followers that differ most."""
    shown = list(vehicles) or shown_followers(comparison)
    strips = STRIP_IN * len(shown) * len(comparison.runs) + 0.3
    heights = (1.45, 1.2, 1.2, strips, 1.35)
    figure = figure_class(figsize=(PAGE_IN, sum(heights) + 1.6), layout="constrained")
    rows = figure.subplots(len(heights), 2, height_ratios=heights)
    for axis in (TIME, PLACE):
        _draw_errors(rows[0, axis], comparison, shown, axis)
        _draw_differences(rows[1, axis], comparison, shown, axis)
        _draw_gaps(rows[2, axis], comparison, shown, axis)
        _draw_modes(rows[3, axis], comparison, shown, axis)
        for row in range(4):
            _mark_divergence(rows[row, axis], comparison, axis)
            rows[row, axis].sharex(rows[3, axis])
            rows[row, axis].label_outer()
        rows[3, axis].set_xlabel(("time, s", "distance along the path of A, m")[axis])
        rows[3, axis].tick_params(labelbottom=True)
    for axes, figure_name in zip(rows[4], ("largest", "rms"), strict=True):
        _draw_string(axes, comparison, figure_name)
    figure.legend(handles=_run_handles(comparison), loc="outside upper left")
    figure.legend(handles=_handles(comparison, shown), loc="outside lower center", ncols=5)
    return figure


def shown_followers(comparison: RunComparison) -> list[str]:
    """Followers that differ most, in the order of the convoy."""
    _, *followers = comparison.runs[0].vehicles
    largest = dict.fromkeys(followers, 0.0)
    for one in comparison.differences:
        if one.vehicle in largest:
            largest[one.vehicle] = max(largest[one.vehicle], abs(one.largest[0]))
    worst = sorted(followers, key=lambda name: -largest[name])[:MOST_SHOWN]
    return [name for name in followers if name in worst]


def _colour(comparison: RunComparison, name: str) -> tuple[float, float, float]:
    red, green, blue = colour_of(list(comparison.runs[0].vehicles).index(name))
    return red / 255.0, green / 255.0, blue / 255.0


def _style(comparison: RunComparison, number: int, name: str) -> dict[str, Any]:
    return {
        "color": _colour(comparison, name),
        "linestyle": LINES[number % len(LINES)],
        "linewidth": 1.3 if number == 0 else 1.0,
        "alpha": 0.55 if number == 0 else 1.0,
    }


def _along(vehicle: PlacedVehicle, axis: int) -> Floats:
    at_s: Floats = vehicle.true.t_s
    return at_s if axis == TIME else vehicle.station_m


def _draw_errors(axes: Axes, comparison: RunComparison, shown: Sequence[str], axis: int) -> None:
    for number, name, vehicle in _each(comparison, shown):
        x = _along(vehicle, axis)
        axes.plot(x, vehicle.true.error_m, **_style(comparison, number, name))
    axes.set_ylabel("error, m")
    axes.set_title("error from the lead's path, left positive" if axis == TIME else "", loc="left")


def _draw_gaps(axes: Axes, comparison: RunComparison, shown: Sequence[str], axis: int) -> None:
    for number, name, vehicle in _each(comparison, shown):
        x = _along(vehicle, axis)
        axes.plot(x, vehicle.true.gap_m, **_style(comparison, number, name))
    axes.set_ylabel("gap, m")
    axes.set_title("gap to the vehicle ahead, bumper to bumper" if axis == TIME else "", loc="left")


def _draw_differences(
    axes: Axes, comparison: RunComparison, shown: Sequence[str], axis: int
) -> None:
    labels = [run.label for run in comparison.runs]
    for one in comparison.differences:
        if one.vehicle in shown:
            style = _style(comparison, labels.index(one.label), one.vehicle)
            axes.plot(_of(one, axis), one.offset_m, **style)
    axes.set_ylabel("difference, m")
    others = ", ".join(labels[1:])
    title = f"offset of {others} minus that of A at the same place"
    axes.set_title(title if axis == TIME else "", loc="left")


def _of(one: OffsetDifference, axis: int) -> Floats:
    return one.at_s if axis == TIME else one.station_m


def _draw_modes(axes: Axes, comparison: RunComparison, shown: Sequence[str], axis: int) -> None:
    colours = PANELS["mode"].states
    rows = [(name, run) for name in shown for run in comparison.runs if name in run.vehicles]
    for row, (name, run) in enumerate(rows):
        vehicle = run.vehicles[name]
        edges = np.array([*(change.at_s for change in vehicle.modes), vehicle.true.t_s[-1]])
        if axis == PLACE:
            edges = vehicle.station_at(np.clip(edges, vehicle.true.t_s[0], None))
        for (begin, end), change in zip(pairwise(edges.tolist()), vehicle.modes, strict=True):
            red, green, blue = colours[change.mode]
            colour = (red / 255.0, green / 255.0, blue / 255.0)
            axes.broken_barh([(begin, end - begin)], (row - 0.45, 0.9), facecolors=[colour])
    axes.set_yticks(range(len(rows)), [f"{name} {run.label}" for name, run in rows])
    axes.tick_params(axis="y", labelsize=6.0, length=0)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(visible=False)
    axes.set_title("modes" if axis == TIME else "", loc="left")


def _mark_divergence(axes: Axes, comparison: RunComparison, axis: int) -> None:
    first = comparison.first
    if first is not None:
        axes.axvline(first.at_s if axis == TIME else first.station_m, **MARK)


def _draw_string(axes: Axes, comparison: RunComparison, figure: str) -> None:
    axes.set_title(f"error along the string, {figure}", loc="left")
    axes.set(xlabel="vehicle", ylabel="error, m")
    for number, run in enumerate(comparison.runs):
        errors = run.string_errors
        if not errors:
            continue
        values = [row.error_m_max if figure == "largest" else row.error_m_rms for row in errors]
        known = [np.nan if value is None else value for value in values]
        axes.plot(
            [row.number for row in errors],
            known,
            color=str(0.65 * (number == 0)),
            linestyle=LINES[number % len(LINES)],
            marker="osd^v<>*"[number],
            markersize=3.5,
            label=run.label,
        )
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(mpl.ticker.MaxNLocator(integer=True))


def _each(comparison: RunComparison, shown: Sequence[str]) -> list[tuple[int, str, PlacedVehicle]]:
    return [
        (number, name, run.vehicles[name])
        for number, run in enumerate(comparison.runs)
        for name in shown
        if name in run.vehicles
    ]


def _run_handles(comparison: RunComparison) -> list[Any]:
    return [
        Line2D(
            [],
            [],
            label=fill(run.title, TITLE_WIDTH, subsequent_indent="   "),
            linestyle=LINES[number % len(LINES)],
            color=str(0.65 * (number == 0)),
        )
        for number, run in enumerate(comparison.runs)
    ]


def _handles(comparison: RunComparison, shown: Sequence[str]) -> list[Any]:
    """Entries of the legend: vehicles, the first divergence, modes that occur."""
    handles: list[Any] = [
        Line2D([], [], color=_colour(comparison, name), label=name) for name in shown
    ]
    if comparison.first is not None:
        handles.append(Line2D([], [], label="first divergence", **MARK))
    used = {change.mode for _, _, one in _each(comparison, shown) for change in one.modes}
    for mode, colour in PANELS["mode"].states.items():
        if mode in used:
            red, green, blue = colour
            handles.append(
                Patch(color=(red / 255.0, green / 255.0, blue / 255.0), label=f"mode {mode}")
            )
    return handles
