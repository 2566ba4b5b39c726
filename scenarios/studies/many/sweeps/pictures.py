"""Pictures of a sweep: heat maps with the contour of a limit, lines with bands, distributions.

Needs matplotlib. Two keys make heat maps, three several of them, one a line, none only the
distribution over the seeds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from scenarios.definition.run_limits import Limit
from scenarios.studies.many.sweeps.axis import SweepAxis
from scenarios.studies.many.sweeps.cell_table import SweepCell, SweepTable
from scenarios.studies.picture_style import BLUE, GREY, ORANGE, RED, SEQUENCE, STYLE

HALF = 0.5
"""Share of broken runs at which the boundary of a limit is drawn."""
MOST_PANELS = 12
PANEL_IN = (4.0, 3.2)
MOST_LABELS = 12
"""Values that an axis is labelled with."""
MOST_NUMBERS = 40
"""Cells that are large enough to have their value written into them."""
BRIGHT = 0.6
"""Share of the colours from which on black is read better than white."""
MOST_NAMED = 8
"""Cells with a name of their own in the legend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPanel:
    """The values of each cell in one picture, and the bound to mark."""

    title: str
    values: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    bound: float | None
    is_share: bool


def _panels(table: SweepTable) -> Iterator[SweepPanel]:
    """Yield the share of each limit with its interval, and medians of figures (5 to 95 %)."""
    for number, limit in enumerate(table.plan.limits):
        shares = [cell.limits[number] for cell in table.cells]
        yield SweepPanel(
            title=f"share of runs that break {limit} (line: half)",
            values=_numbers(share.ratio for share in shares),
            low=_numbers(share.low for share in shares),
            high=_numbers(share.high for share in shares),
            bound=HALF,
            is_share=True,
        )
    for number, figure in enumerate(table.plan.figures):
        spreads = [cell.figures[number] for cell in table.cells]
        bound = _bound_of(figure.name, table.plan.limits)
        line = "" if bound is None else f" (line: {bound:g})"
        yield SweepPanel(
            title=f"{figure.name}, median{line}",
            values=_numbers(spread.median for spread in spreads),
            low=_numbers(spread.p5 for spread in spreads),
            high=_numbers(spread.p95 for spread in spreads),
            bound=bound,
            is_share=False,
        )


def _bound_of(figure: str, limits: Sequence[Limit]) -> float | None:
    """Return the bound of the limit on a figure, named as in `--figure`; None without one."""
    for limit in limits:
        vehicle = f"{limit.vehicle}." if limit.vehicle else ""
        if f"{vehicle}{limit.row.figure}" == figure:
            return limit.bound
    return None


def _numbers(values: Any) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def why_no_heat_map(table: SweepTable) -> str:
    """Return the reason if the cells cannot be drawn, else an empty text."""
    axes = table.plan.axes
    if not axes:
        return "no heat map: no key varies; seeds.png has the distribution over the seeds"
    if len(axes) > 3:
        return f"no heat map: {len(axes)} keys vary, three can be drawn; fix some by --set"
    if len(axes) == 3 and len(axes[0].texts) > MOST_PANELS:
        count = len(axes[0].texts)
        return f"no heat map: {axes[0].key} has {count} values, {MOST_PANELS} can be drawn"
    return ""


@mpl.rc_context(STYLE)
def sweep_figure(table: SweepTable) -> Figure:
    axes, panels = table.plan.axes, list(_panels(table))
    if len(axes) == 3:
        return _multiples(axes, panels[0])
    figure, places = _places(panels)
    for place, panel in zip(places, panels, strict=True):
        if len(axes) == 2:
            _heat(figure, place, axes, panel, panel.values)
        else:
            _line(place, axes[0], panel)
    return figure


def _places(panels: Sequence[object]) -> tuple[Figure, list[Axes]]:
    """Make a figure with a place for each panel, three in a row."""
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(columns * PANEL_IN[0], rows * PANEL_IN[1]), layout="constrained")
    places = list(figure.subplots(rows, columns, squeeze=False).flat)
    for place in places[len(panels) :]:
        place.set_axis_off()
    return figure, places[: len(panels)]


def _positions(axis: SweepAxis) -> NDArray[np.float64]:
    """Positions of a key's values: ascending numbers at their place, others side by side."""
    numbers = axis.numbers
    if numbers is None or any(np.diff(numbers) <= 0.0):
        return np.arange(len(axis.texts), dtype=float)
    return np.array(numbers)


def _labels(axis: SweepAxis) -> tuple[NDArray[np.float64], list[str]]:
    step = -(-len(axis.texts) // MOST_LABELS)
    return _positions(axis)[::step], list(axis.texts[::step])


def _heat(
    figure: Figure,
    place: Axes,
    axes: Sequence[SweepAxis],
    panel: SweepPanel,
    values: NDArray[np.float64],
) -> None:
    """Draw the cells in colour, the first key along x, and the contour of the bound."""
    along, up = axes[-2:]
    grid = values.reshape(len(along.texts), len(up.texts)).T
    x, y = _positions(along), _positions(up)
    least, most = _ends(panel)
    mesh = place.pcolormesh(x, y, grid, shading="nearest", cmap=SEQUENCE, vmin=least, vmax=most)
    figure.colorbar(mesh, ax=place)
    if panel.bound is not None and min(grid.shape) > 1:
        inside = grid[np.isfinite(grid)]
        if inside.size and inside.min() < panel.bound < inside.max():
            place.contour(x, y, grid, levels=[panel.bound], colors=[RED], linewidths=1.6)
    if grid.size <= MOST_NUMBERS:
        dark = least + BRIGHT * (most - least)
        _number(place, x.tolist(), y.tolist(), grid.tolist(), dark, share=panel.is_share)
    place.set_xticks(*_labels(along))
    place.set_yticks(*_labels(up))
    place.set(xlabel=along.key, ylabel=up.key, title=panel.title)
    place.grid(visible=False)


def _number(
    place: Axes,
    x: Sequence[float],
    y: Sequence[float],
    rows: Sequence[Sequence[float]],
    dark: float,
    *,
    share: bool,
) -> None:
    """Write each cell's value into it: a share in percent, a figure to two digits.

    Values up to `dark` have a dark colour.
    """
    for up, row in zip(y, rows, strict=True):
        for along, value in zip(x, row, strict=True):
            if isfinite(value):
                text = f"{100.0 * value:.0f} %" if share else f"{value:.2g}"
                ink = "black" if value > dark else "white"
                place.text(along, up, text, color=ink, ha="center", va="center", fontsize=7.0)


def _ends(panel: SweepPanel) -> tuple[float, float]:
    """Values of the first and the last colour, the same in all parts of a picture."""
    known = panel.values[np.isfinite(panel.values)]
    if panel.is_share or not known.size:
        return 0.0, 1.0
    return float(known.min()), float(known.max())


def _multiples(axes: Sequence[SweepAxis], panel: SweepPanel) -> Figure:
    """Draw a heat map over the last two keys for each value of the first one."""
    texts = axes[0].texts
    parts = panel.values.reshape(len(texts), -1)
    figure, places = _places(texts)
    for place, text, part in zip(places, texts, parts, strict=True):
        _heat(figure, place, axes, panel, part)
        place.set_title(f"{axes[0].key}={text}")
    figure.suptitle(panel.title, fontsize=10.0)
    return figure


def _line(place: Axes, axis: SweepAxis, panel: SweepPanel) -> None:
    x = _positions(axis)
    place.fill_between(x, panel.low, panel.high, color=BLUE, alpha=0.2, linewidth=0.0)
    place.plot(x, panel.values, "o-", color=BLUE, markersize=3.0)
    if panel.bound is not None:
        place.axhline(panel.bound, color=RED, linewidth=0.9, linestyle=":")
    place.set_xticks(*_labels(axis))
    band = "95 % interval" if panel.is_share else "5 to 95 % of the runs"
    place.set(xlabel=axis.key, title=f"{panel.title}, {band}")
    if panel.is_share:
        place.set_ylim(-0.03, 1.03)


@mpl.rc_context(STYLE)
def seeds_figure(table: SweepTable) -> Figure:
    """Draw the distribution of each figure over the seeds, a line for each cell."""
    figure, places = _places(table.plan.figures)
    for number, place in enumerate(places):
        for cell, colour in zip(table.cells, _colours(table), strict=True):
            _distribution(place, cell, number, colour)
        name = table.plan.figures[number].name
        if (bound := _bound_of(name, table.plan.limits)) is not None:
            place.axvline(bound, color=RED, linewidth=0.9, linestyle=":")
        place.set(xlabel=name, ylabel="share of the runs", title=_over(table))
        lines = place.get_legend_handles_labels()[0]
        if table.plan.axes and lines and len(table.cells) <= MOST_NAMED:
            keys = ", ".join(axis.key for axis in table.plan.axes)
            place.legend(loc="lower right", title=keys, title_fontsize=7.5)
    return figure


def _over(table: SweepTable) -> str:
    """Return the number of seeds, and the meaning of colours without a legend."""
    several = f", blue to orange: {len(table.cells)} cells in their order"
    return f"{table.plan.seeds} seeds{several if len(table.cells) > MOST_NAMED else ''}"


def _colours(table: SweepTable) -> list[Any]:
    """Colours from blue to orange in the order of the cells; grey for a single cell."""
    if len(table.cells) == 1:
        return [GREY]
    map_ = mpl.colors.LinearSegmentedColormap.from_list("cells", [BLUE, ORANGE])
    return [map_(share) for share in np.linspace(0.0, 1.0, len(table.cells))]


def _distribution(place: Axes, cell: SweepCell, number: int, colour: Any) -> None:
    values = [run.figures[number] for run in cell.runs if not run.error]
    known = np.sort([value for value in values if value is not None])
    if known.size:
        place.ecdf(known, color=colour, linewidth=1.2, label=", ".join(cell.values))
