"""Plots of a sweep: lines with 95 % intervals, heat maps, and distributions over the seeds.

Needs Matplotlib. One key makes a line. Of two keys, one is along x, and each value of the other has
a line; two numeric keys make a heat map with the contour of a limit. Without a key only the
distribution over the seeds is drawn.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from textwrap import fill
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scenarios.definition.run_limits import Limit
from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.studies.axis_labels import axis_label
from scenarios.studies.many.sweeps.axis import SweepAxis
from scenarios.studies.many.sweeps.cell_table import SweepTable
from scenarios.studies.picture_style import (
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
    ink_on,
)

HALF = 0.5
"""Share of broken runs at which the boundary of a limit is drawn."""
PANEL_HEIGHT_IN = 2.8
LABEL_WIDTH = 30
"""Characters of a line of a label along y."""
MOST_LABELS = 8
"""Values that an axis is labelled with."""
WIDEST_LABELS = 32
"""Characters of all labels together; longer ones are slanted."""
MOST_NUMBERS = 40
"""Cells that are large enough to have their value written into them."""
MOST_NAMED = 8
"""Cells with a name of their own in the legend."""
PERCENT = 100.0
SHIFT_RATIO = 0.006
"""Shift of a line from the next one, relative to the x axis, so that intervals do not overlap."""
COLOURS = (BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY)


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPanel:
    """The values of each cell in one plot, in the unit of its label, and the bound to mark."""

    label: str
    title: str
    values: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    bound: float | None
    is_share: bool

    def of(self, cells: Any) -> "SweepPanel":
        """The panel of some cells only."""
        return replace(self, values=self.values[cells], low=self.low[cells], high=self.high[cells])


def _panels(table: SweepTable) -> Iterator[SweepPanel]:
    """Yield the share of each limit and the mean of each figure, with 95 % intervals."""
    for number, limit in enumerate(table.plan.limits):
        shares = [cell.limits[number] for cell in table.cells]
        yield SweepPanel(
            label=f"runs that break {limit}, %",
            title=f"Runs that break {limit}",
            values=PERCENT * _numbers(share.ratio for share in shares),
            low=PERCENT * _numbers(share.low for share in shares),
            high=PERCENT * _numbers(share.high for share in shares),
            bound=PERCENT * HALF,
            is_share=True,
        )
    for number, figure in enumerate(table.plan.figures):
        spreads = [cell.figures[number] for cell in table.cells]
        bound = _bound_of(figure.name, table.plan.limits)
        label = axis_label(figure.name)
        yield SweepPanel(
            label=label.text,
            title="Mean of the runs",
            values=label.factor * _numbers(spread.mean for spread in spreads),
            low=label.factor * _numbers(spread.mean_low for spread in spreads),
            high=label.factor * _numbers(spread.mean_high for spread in spreads),
            bound=None if bound is None else label.factor * bound,
            is_share=False,
        )


def _bound_of(figure: str, limits: Sequence[Limit]) -> float | None:
    """Return the bound of the limit on a figure, named as in `--figure`; None without one."""
    for limit in limits:
        vehicle = f"{limit.vehicle}." if limit.vehicle else ""
        own = limit.row.own_figure
        if f"{vehicle}{f'{OWN_FIGURES}.{own}' if own else limit.row.figure}" == figure:
            return limit.bound
    return None


def _numbers(values: Any) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def why_no_plot(table: SweepTable) -> str:
    """Return the reason if the cells cannot be drawn, else an empty text."""
    axes = table.plan.axes
    if not axes:
        return "no plot over a key: no key varies; the plot of the seeds shows their distribution"
    if len(axes) > 2:
        return f"no plot: {len(axes)} keys vary, two can be drawn; fix some by --set"
    return ""


@mpl.rc_context(STYLE)
def sweep_figure(table: SweepTable) -> Figure:
    """Draw each limit and figure of a sweep over one or two keys."""
    axes, panels = table.plan.axes, list(_panels(table))
    is_map = len(axes) == 2 and not any(map(_is_category, axes))
    figure, places = _places(panels)
    for place, panel in zip(places, panels, strict=True):
        if is_map:
            _heat(figure, place, axes, panel)
            place.set_title(panel.title)
        else:
            _lines(place, axes, panel)
    if len(axes) == 2 and not is_map:
        handles = places[0].get_legend_handles_labels()
        title = axis_label(axes[1 - _along(axes)].key).text
        figure.legend(*handles, loc="outside lower center", title=title, ncols=3)
    return figure


def _along(axes: Sequence[SweepAxis]) -> int:
    """Number of the key along x: the first numeric one, else the last."""
    return next((k for k, axis in enumerate(axes) if not _is_category(axis)), len(axes) - 1)


def _places(panels: Sequence[object]) -> tuple[Figure, list[Axes]]:
    """Make a figure with a place for each panel: one in a column, two on a page's width."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    width = COLUMN_IN if columns == 1 else PAGE_IN
    figure = Figure(figsize=(width, rows * PANEL_HEIGHT_IN), layout="constrained")
    places = list(figure.subplots(rows, columns, squeeze=False).flat)
    for place in places[len(panels) :]:
        place.set_axis_off()
    return figure, places[: len(panels)]


def _positions(axis: SweepAxis) -> NDArray[np.float64]:
    """Positions of a key's values: ascending numbers at their place, others side by side."""
    if _is_category(axis):
        return np.arange(len(axis.texts), dtype=float)
    return axis_label(axis.key).factor * np.array(axis.numbers)


def _is_category(axis: SweepAxis) -> bool:
    numbers = axis.numbers
    return numbers is None or any(np.diff(numbers) <= 0.0)


def _labels(axis: SweepAxis) -> tuple[NDArray[np.float64], list[str]]:
    step = -(-len(axis.texts) // MOST_LABELS)
    texts = [_shown(axis, text) for text in axis.texts]
    return _positions(axis)[::step], list(texts[::step])


def _shown(axis: SweepAxis, text: str) -> str:
    """A value in the unit of the axis's label."""
    return text if axis.numbers is None else f"{axis_label(axis.key).factor * float(text):g}"


def _heat(
    figure: Figure,
    place: Axes,
    axes: Sequence[SweepAxis],
    panel: SweepPanel,
) -> None:
    """Draw the cells in colour, the first key along x, and the contour of the bound."""
    along, up = axes
    grid = panel.values.reshape(len(along.texts), len(up.texts)).T
    x, y = _positions(along), _positions(up)
    least, most = _ends(panel)
    mesh = place.pcolormesh(x, y, grid, shading="nearest", cmap=SEQUENCE, vmin=least, vmax=most)
    bar = figure.colorbar(mesh, ax=place)
    bar.set_label(panel.label)
    if panel.bound is not None and min(grid.shape) > 1:
        inside = grid[np.isfinite(grid)]
        if inside.size and inside.min() < panel.bound < inside.max():
            place.contour(x, y, grid, levels=[panel.bound], colors=[RED], linewidths=1.6)
            bar.ax.axhline(panel.bound, color=RED, linewidth=1.6)
    if grid.size <= MOST_NUMBERS:
        for (row, column), value in np.ndenumerate(grid):
            if isfinite(value):
                ink = ink_on(mesh.to_rgba(np.array([value]))[0])
                text = f"{value:.0f}" if panel.is_share else f"{value:.2g}"
                place.text(float(x[column]), float(y[row]), text, color=ink, ha="center",
                           va="center", fontsize=SMALL_PT)  # fmt: skip
    place.set_xticks(*_labels(along))
    place.set_yticks(*_labels(up))
    place.set(xlabel=axis_label(along.key).text, ylabel=axis_label(up.key).text)
    place.grid(visible=False)


def _ends(panel: SweepPanel) -> tuple[float, float]:
    """Values of the first and the last colour, the same in all parts of a plot."""
    known = panel.values[np.isfinite(panel.values)]
    if not known.size:
        return 0.0, 1.0
    least, most = float(known.min()), float(known.max())
    return (least, most) if most > least else (least - 0.5, most + 0.5)


def _lines(place: Axes, axes: Sequence[SweepAxis], panel: SweepPanel) -> None:
    """Draw a line for each value of the key that is not along x, with its intervals."""
    axis = axes[_along(axes)]
    cells = np.arange(len(panel.values)).reshape([len(each.texts) for each in axes])
    rows = np.moveaxis(cells, _along(axes), -1).reshape(-1, len(axis.texts))
    other = axes[1 - _along(axes)] if len(axes) == 2 else None
    names = ["" if other is None else _shown(other, text) for text in (other or axis).texts]
    reach = SHIFT_RATIO * float(np.ptp(_positions(axis)))
    for number, row in enumerate(rows):
        part, shift = panel.of(row), reach * (number - 0.5 * (len(rows) - 1))
        band = [part.values - part.low, part.high - part.values]
        place.errorbar(
            _positions(axis) + shift,
            part.values,
            yerr=np.nan_to_num(np.maximum(band, 0.0)),
            fmt="o" if _is_category(axis) else "o-",  # no line joins categories
            color=COLOURS[number % len(COLOURS)],
            markersize=3.5,
            elinewidth=0.9,
            capsize=2.0,
            label=names[number] or None,
        )
    if _is_category(axis):
        place.set_xlim(-0.5, len(axis.texts) - 0.5)
    _label(place, axis, panel)


def _label(place: Axes, axis: SweepAxis, panel: SweepPanel) -> None:
    if panel.bound is not None:
        place.axhline(panel.bound, color=RED, linewidth=0.9, linestyle=":")
    places, texts = _labels(axis)
    place.set_xticks(places, texts)
    if _is_category(axis) and max(map(len, texts)) * len(texts) > WIDEST_LABELS:
        place.tick_params(axis="x", labelrotation=25.0)
        for tick in place.get_xticklabels():
            tick.set(ha="right", rotation_mode="anchor")
    place.set(
        xlabel=axis_label(axis.key).text,
        ylabel=fill(panel.label, LABEL_WIDTH),
        title=f"{panel.title}, 95 % interval",
    )
    if panel.is_share:
        place.set_ylim(-3.0, 103.0)


@mpl.rc_context(STYLE)
def seeds_figure(table: SweepTable) -> Figure:
    """Draw the distribution of each figure over the seeds, a line for each cell."""
    figure, places = _places(table.plan.figures)
    for number, place in enumerate(places):
        name = table.plan.figures[number].name
        label = axis_label(name)
        for cell, colour in zip(table.cells, _colours(table), strict=True):
            values = zip(table.plan.axes, cell.values, strict=True)
            text = "; ".join(_shown(axis, value) for axis, value in values)
            runs = [run.figures[number] for run in cell.runs if not run.error]
            known = [label.factor * value for value in runs if value is not None]
            _distribution(place, known, colour, text)
        if (bound := _bound_of(name, table.plan.limits)) is not None:
            place.axvline(label.factor * bound, color=RED, linewidth=0.9, linestyle=":")
        place.set(xlabel=label.text, ylabel="runs, %", title=_over(table))
    lines = places[0].get_legend_handles_labels() if places else ([], [])
    if table.plan.axes and lines[0] and len(table.cells) <= MOST_NAMED:
        keys = "; ".join(axis_label(axis.key).text for axis in table.plan.axes)
        figure.legend(*lines, loc="outside lower center", title=keys, ncols=2 * len(places))
    return figure


def _over(table: SweepTable) -> str:
    """Return the number of seeds, and the meaning of colours without a legend."""
    several = f", {len(table.cells)} cells from blue to orange"
    return f"{table.plan.seeds} seeds{several if len(table.cells) > MOST_NAMED else ''}"


def _colours(table: SweepTable) -> list[Any]:
    """Colours from blue to orange in the order of the cells; grey for a single cell."""
    if len(table.cells) == 1:
        return [GREY]
    map_ = mpl.colors.LinearSegmentedColormap.from_list("cells", [BLUE, ORANGE])
    return [map_(share) for share in np.linspace(0.0, 1.0, len(table.cells))]


def _distribution(place: Axes, values: Sequence[float], colour: Any, text: str) -> None:
    known = np.sort(values)
    if known.size:
        shares = PERCENT * np.arange(1, known.size + 1) / known.size
        place.step(
            [known[0], *known],
            [0.0, *shares],
            where="post",
            color=colour,
            linewidth=1.2,
            label=text,
        )
