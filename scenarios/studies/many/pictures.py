"""The plot of `convoy bisect`: shares of broken runs over the value."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scenarios.definition.run_limits import Limit
from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.results.figure_style import (
    BLUE,
    COLUMN_IN,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    PURPLE,
    RED,
    SEQUENCE,
    SKY,
    SMALL_PT,
    STYLE,
)
from scenarios.studies.many.boundary import BoundaryQuery, BoundaryResult, grouped
from scenarios.studies.many.cell_table import SweepTable
from scenarios.studies.many.plan import SweepAxis
from scenarios.studies.many.variant import agresti_coull

# ---- Labels with units for keys of a scenario and for fields of the summary


UNITS = {
    "m": "m",
    "s": "s",
    "ms": "ms",
    "ns": "ns",
    "hz": "Hz",
    "mps": "m/s",
    "mps2": "m/s²",
    "mps3": "m/s³",
    "rad": "rad",
    "radps": "rad/s",
    "deg": "°",
    "per_m": "1/m",
    "per_s": "1/s",
    "kg": "kg",
    "db": "dB",
    "ppm": "ppm",
    "bytes": "bytes",
    "ratio": "%",
}
PERCENT = 100.0
QUALIFIERS = {
    "max": "largest ",
    "min": "smallest ",
    "mean": "mean ",
    "rms": "rms ",
    "p95": "95th percentile of ",
}
PLACES = {"links": " of all links", "convoy": "", "events": " events"}
"""Words for the first part of a name; other parts are put in brackets."""
_NAME = re.compile(
    rf"(?P<name>\w+?)_(?P<unit>{'|'.join(UNITS)})(?:_(?P<qualifier>{'|'.join(QUALIFIERS)}))?"
)


@dataclass(frozen=True, slots=True)
class AxisLabel:
    """Text of an axis, and the factor by which values are multiplied on it (100 for ratios)."""

    text: str
    factor: float = 1.0


def axis_label(name: str) -> AxisLabel:
    """Label of a key such as `links.loss_ratio` or a field such as `cross_track_error_m_max`."""
    place, _, last = name.rpartition(".")
    where = PLACES.get(place, f" ({place})" if place else "")
    match = _NAME.fullmatch(last)
    if match is None:
        return AxisLabel(f"{_words(last)}{where}")
    qualifier = QUALIFIERS.get(match["qualifier"] or "", "")
    factor = PERCENT if match["unit"] == "ratio" else 1.0
    return AxisLabel(f"{qualifier}{_words(match['name'])}{where}, {UNITS[match['unit']]}", factor)


def _words(name: str) -> str:
    return name.replace("cross_track", "cross-track").replace("_", " ")


def ink_on(colour: tuple[float, ...]) -> str:
    """Colour of a text that is legible on a background (RGB or RGBA from 0 to 1)."""
    red, green, blue = colour[:3]
    return "black" if 0.299 * red + 0.587 * green + 0.114 * blue > 0.5 else "white"


# ---- The picture of bisect

SIZE = (COLUMN_IN, 3.4)
MOST_GROUPS = 16


@mpl.rc_context(STYLE)
def drawn(query: BoundaryQuery, result: BoundaryResult) -> Figure:
    """Draw the shares of groups of runs, the fitted curve, and the interval of the boundary."""
    label = axis_label(query.key)
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    if result.boundary is not None:
        ends = (
            query.low if result.low is None else result.low,
            query.high if result.high is None else result.high,
        )
        axes.axvspan(*(label.factor * end for end in ends), color=ORANGE, alpha=0.3, linewidth=0,
                     label="boundary, 95 % interval")  # fmt: skip
        axes.axvline(label.factor * result.boundary, color=RED, linewidth=0.9)
        axes.plot([label.factor * one.low for one in result.points],
                  [100.0 * one.fitted for one in result.points],
                  color=BLUE, linewidth=1.0, label="fitted share")  # fmt: skip
    axes.axhline(100.0 * query.share, color=GREY, linewidth=0.9, linestyle=":")
    groups = grouped(result.points, MOST_GROUPS)
    intervals = [agresti_coull(one.broken, one.runs) for one in groups]
    axes.errorbar(
        [0.5 * label.factor * (one.low + one.high) for one in groups],
        [100.0 * one.share for one in groups],
        xerr=[0.5 * label.factor * (one.high - one.low) for one in groups],
        yerr=[
            [100.0 * (one.share - low) for one, (low, _) in zip(groups, intervals, strict=True)],
            [100.0 * (high - one.share) for one, (_, high) in zip(groups, intervals, strict=True)],
        ],
        fmt="o", color=BLUE, markersize=3.5, elinewidth=0.9, capsize=2.0,
        label="share of the runs, 95 % interval",
    )  # fmt: skip
    margin = 0.03 * (query.high - query.low)
    ends = (label.factor * (query.low - margin), label.factor * (query.high + margin))
    axes.set(ylim=(-3.0, 103.0), xlim=ends, xlabel=label.text)
    axes.set_ylabel(f"runs that break {query.limit}, %")
    axes.set_title(query.variant.name)
    figure.legend(loc="outside lower center")
    return figure


# ---- The picture of a sweep: lines with 95 % intervals, or heat maps
#
# One key gives one line. Of two keys, one with numbers is the x axis, and each value of the other
# one has a line. Two keys with numbers give heat maps.


Floats = NDArray[np.float64]
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)
MARKERS = "osD^vPX"
PANEL_HEIGHT_IN = 2.8
MOST_NUMBERS = 40
"""Cells that are large enough to have their value written into them."""
MOST_TICKS = 8
SHIFT_RATIO = 0.008
"""Shift of a line from the next one, relative to the x axis, so that intervals do not overlap."""


class SweepPanel(NamedTuple):
    """Values of the cells with the ends of their intervals, in the unit of the label; a bound."""

    label: str
    cells: Floats  # value, lower and upper end by cell
    bound: float | None
    is_share: bool


def _panels(table: SweepTable) -> Iterator[SweepPanel]:
    """Yield the share of runs that break each limit, and the mean of each metric."""
    for number, limit in enumerate(table.plan.limits):
        shares = [cell.limits[number] for cell in table.cells]
        cells = np.array([(one.ratio, one.low, one.high) for one in shares], dtype=float).T
        yield SweepPanel(_wrapped(f"runs that break {limit}, %"), PERCENT * cells, None, True)
    for number, metric in enumerate(table.plan.figures):
        spreads = [cell.figures[number] for cell in table.cells]
        cells = np.array(
            [(one.mean, one.mean_low, one.mean_high) for one in spreads], dtype=float
        ).T
        bound, label = _bound_of(metric.name, table.plan.limits), axis_label(metric.name)
        at = None if bound is None else label.factor * bound
        yield SweepPanel(_wrapped(label.text), label.factor * cells, at, False)


def _wrapped(label: str) -> str:
    return fill(label, 32)


def _bound_of(metric: str, limits: Sequence[Limit]) -> float | None:
    """Return the bound of the limit on a metric, named as in `--metric`; None without one."""
    for limit in limits:
        vehicle = f"{limit.vehicle}." if limit.vehicle else ""
        own = limit.row.own_figure
        if f"{vehicle}{f'{OWN_FIGURES}.{own}' if own else limit.row.figure}" == metric:
            return limit.bound
    return None


@mpl.rc_context(STYLE)
def sweep_picture(table: SweepTable) -> Figure:
    """Draw a panel for each limit and metric; `plan.refuse_picture` states which axes it takes."""
    panels, axes, seeds = list(_panels(table)), table.plan.axes, table.plan.seeds
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    size = COLUMN_IN if columns == 1 else PAGE_IN, rows * PANEL_HEIGHT_IN
    figure = Figure(figsize=size, layout="constrained")
    places = list(figure.subplots(rows, columns, squeeze=False).flat)
    is_map = len(axes) == 2 and all(axis.numbers for axis in axes)
    for place, panel in zip(places, panels, strict=False):
        (_draw_map if is_map else _draw_lines)(place, axes, panel)
    for place in places[len(panels) :]:
        place.set_axis_off()
    if len(axes) == 2 and not is_map:
        other = next(axis for axis in axes if not axis.numbers)
        lines = places[0].get_legend_handles_labels()
        title = axis_label(other.key).text
        figure.legend(*lines, loc="outside lower center", title=title, ncols=2 * columns)
    drawn = "mean" if is_map else "mean and 95 % interval"
    figure.suptitle(f"{drawn} of {seeds} run{'s' if seeds > 1 else ''}")
    return figure


def _draw_lines(place: Axes, axes: Sequence[SweepAxis], panel: SweepPanel) -> None:
    """Draw a line with its intervals for each value of the key that is not the x axis."""
    along = next((number for number, axis in enumerate(axes) if axis.numbers), 0)
    axis, others = axes[along], [one for number, one in enumerate(axes) if number != along]
    x, order = _positions(axis)
    names = others[0].texts if others else ("",)
    reach = SHIFT_RATIO * float(np.ptp(x))
    lines = np.moveaxis(_grid(axes, panel.cells), along + 1, -1)
    values, low, high = lines.reshape(3, len(names), len(x))[..., order]
    for number, name in enumerate(names):
        mean = values[number]
        ends = np.nan_to_num([mean - low[number], high[number] - mean])
        place.errorbar(
            x[order] + reach * (number - 0.5 * (len(names) - 1)),
            mean,
            yerr=np.maximum(ends, 0.0),
            color=_colour(number, len(names)),
            marker=MARKERS[number % len(MARKERS)],
            markersize=3.5,
            linestyle="-" if axis.numbers else "none",  # nothing lies between two categories
            elinewidth=0.9,
            capsize=2.0,
            clip_on=False,
            label=name,
        )
    if panel.bound is not None:
        place.axhline(panel.bound, color=GREY, linewidth=0.9, linestyle=":")
    if not axis.numbers:
        place.set_xticks(x, axis.texts, rotation=25.0, ha="right", rotation_mode="anchor")
        place.set_xlim(-0.5, len(x) - 0.5)
    if panel.is_share:
        place.set_ylim(0.0, PERCENT)
    place.set(xlabel=axis_label(axis.key).text, ylabel=panel.label)


def _draw_map(place: Axes, axes: Sequence[SweepAxis], panel: SweepPanel) -> None:
    """Draw the cells in colour, the first key along x, and the contour of the bound."""
    (x, columns), (y, rows) = map(_positions, axes)
    x, y = x[columns], y[rows]
    grid = _grid(axes, panel.cells)[0].T[np.ix_(rows, columns)]
    ends = (0.0, PERCENT) if panel.is_share else (None, None)
    mesh = place.pcolormesh(
        x, y, grid, shading="nearest", cmap=SEQUENCE, vmin=ends[0], vmax=ends[1]
    )
    place.figure.colorbar(mesh, ax=place, label=panel.label)
    known = grid[np.isfinite(grid)]
    if panel.bound is not None and min(grid.shape) > 1 and known.size:
        # Without a value on either side, Matplotlib warns.
        levels = [panel.bound] if known.min() < panel.bound < known.max() else []
        place.contour(x, y, grid, levels=levels, colors=[RED], linewidths=1.6)
    if grid.size <= MOST_NUMBERS:
        for (row, column), value in np.ndenumerate(grid):
            ink = ink_on(mesh.to_rgba(np.array([value]))[0])
            text = "" if np.isnan(value) else f"{value:.0f}" if panel.is_share else f"{value:.2g}"
            at = float(x[column]), float(y[row])
            place.text(*at, text, color=ink, ha="center", va="center", fontsize=SMALL_PT)
    for set_ticks, values in ((place.set_xticks, x), (place.set_yticks, y)):
        shown = values[:: -(-len(values) // MOST_TICKS)]
        set_ticks(shown, [f"{value:g}" for value in shown])
    place.set(xlabel=axis_label(axes[0].key).text, ylabel=axis_label(axes[1].key).text)
    place.grid(visible=False)


def _positions(axis: SweepAxis) -> tuple[Floats, NDArray[np.intp]]:
    """Positions of the values of a key, side by side without numbers, and their order."""
    count = range(len(axis.texts))
    x = axis_label(axis.key).factor * np.array(axis.numbers or count, dtype=float)
    return x, np.argsort(x)


def _grid(axes: Sequence[SweepAxis], cells: Floats) -> Floats:
    """Rows of values of the cells by the numbers of the values of the keys."""
    return cells.reshape(len(cells), *(len(axis.texts) for axis in axes))


def _colour(number: int, count: int) -> Any:
    if count <= len(COLOURS):
        return COLOURS[number]
    return mpl.colormaps[SEQUENCE](number / (count - 1))
