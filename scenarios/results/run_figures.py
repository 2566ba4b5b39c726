"""Figures of a run: plan, curves over time and path, modes, losses and gains.

`run.plot()`, the HTML report and comparisons draw with the same functions and colours.
"""

import io
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import fill
from typing import Any, get_args

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from scenarios.results.figure_style import (
    MODE_COLOURS,
    PAGE_IN,
    RED,
    STYLE,
    encoded,
    vehicle_colour,
)
from scenarios.results.frequency_gains import SignalName, frequency_gains
from scenarios.results.run_record import RunRecord, mode_changes
from scenarios.results.string_figures import stations
from scenarios.results.summary import RunSummary
from scenarios.results.tables import RunTables, Signal
from scenarios.results.true_motion import path_feet
from scenarios.results.vehicle_figures import NO_SIGNAL, SignalOf, field_of, true_gaps

Floats = NDArray[np.float64]
Curve = tuple[Floats, Floats]
"""Abscissas and values, of equal length; NaN interrupts the line."""
LEAST_HEIGHT = 0.02
"""Least height of an axis (m, m/s, gain), so that rounding errors do not fill it."""
MOST_CURVES = 12
"""Vehicles with curves: as many as there are colours."""
MOST_LINKS = 24
PAGE_POINTS = 24_000
"""Points of all curves of a report, which bound its size."""
CELLS = 600
"""Cells of a strip of modes or losses."""
LEAST_CELL_S = 0.5
"""Shortest time of which a loss is drawn."""
WIDTH_IN = 9.0
"""Width of the figures of a report."""


class NotebookFigure(Figure):
    """A figure that notebooks show without pyplot."""

    def _repr_png_(self) -> bytes:
        file = io.BytesIO()
        self.savefig(file, format="png")
        return file.getvalue()


# ---- Drawing of curves and strips


def thinned(curve: Curve, most: int) -> Curve:
    """Keep the least and the largest value of each of `most` / 2 equal parts, and the ends.

    NaN is kept as a break of the line.
    """
    at, values = curve
    if at.size <= most:
        return curve
    width = -(-at.size // max(most // 2, 1))
    parts = -(-at.size // width)
    padded = np.full(parts * width, np.nan)
    padded[: at.size] = values
    table = padded.reshape(parts, width)
    unknown = np.isnan(table)
    first = np.arange(parts) * width
    least = first + np.where(unknown, np.inf, table).argmin(axis=1)
    largest = first + np.where(unknown, -np.inf, table).argmax(axis=1)
    breaks = (first + unknown.argmax(axis=1))[unknown.any(axis=1)]
    rows = np.unique(np.concatenate([[0, at.size - 1], least, largest, breaks]))
    rows = rows[rows < at.size]
    return at[rows], values[rows]


def draw_curve(axes: Axes, curve: Curve, **style: Any) -> None:
    """Draw known values; the axis has at least `LEAST_HEIGHT`."""
    if not np.isfinite(curve[1]).any():
        return
    axes.plot(*curve, **style)
    low, high = axes.dataLim.intervaly
    margin = max(0.05 * (high - low), 0.5 * (LEAST_HEIGHT - (high - low)))
    axes.set_ylim(low - margin, high + margin)


@dataclass(frozen=True, slots=True)
class ModeStrip:
    """Modes of a vehicle between `edges`, one more than modes; NaN where it is elsewhere."""

    label: str
    edges: Sequence[float]
    modes: Sequence[str]


def draw_strips(axes: Axes, strips: Sequence[ModeStrip], span: tuple[float, float]) -> None:
    """Draw modes as coloured strips; in a cell with several modes, the rarest one is visible."""
    low, high = span
    image = np.zeros((len(strips), CELLS, 4))
    for row, strip in enumerate(strips):
        cells = (np.array(strip.edges, float) - low) / ((high - low) or 1.0) * CELLS
        durations: Counter[str] = Counter()
        spans = list(zip(strip.modes, pairwise(cells.tolist()), strict=True))
        for mode, (begin, end) in spans:
            durations[mode] += end - begin if end > begin else 0.0  # type: ignore[assignment]
        for mode, _ in durations.most_common():
            for other, (begin, end) in spans:
                if other == mode and end >= 0.0 and begin <= CELLS:
                    image[row, max(int(begin), 0) : int(end) + 1] = to_rgba(MODE_COLOURS[mode])
    _draw_image(axes, image, [strip.label for strip in strips], span)


def _draw_image(
    axes: Axes, image: NDArray[np.float64], labels: Sequence[str], span: tuple[float, float]
) -> None:
    """Draw rows of colours (rows, cells, RGBA) with a gap between two rows."""
    spaced = np.repeat(image, 5, axis=0)
    spaced[4::5] = 0.0
    extent = (*span, len(labels) - 0.5, -0.5)
    axes.imshow(spaced, aspect="auto", interpolation="none", extent=extent)
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", labelsize=6.0, length=0)
    axes.grid(visible=False)


# ---- Quantities: the signals that are drawn


def path_errors(run: RunTables, name: str) -> Signal:
    """Offset (m) of a follower from the lead's path and the straight before its start."""
    if name == run.lead:
        return NO_SIGNAL
    return Signal(run.table(name, "truth").at_ns, path_feet(run, name).lateral)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A plotted signal of each vehicle, with its title and unit, and its standard deviation."""

    title: str
    unit: str
    signal: SignalOf
    deviation: SignalOf | None = None
    by_place: bool = False


# fmt: off
QUANTITIES = (
    Quantity("true error from the lead's path", "m, left positive", path_errors, by_place=True),
    Quantity("true gap to the vehicle ahead", "m, bumper to bumper", true_gaps, by_place=True),
    Quantity("speed", "m/s", field_of("truth", "speed_mps")),
    Quantity(
        "self-estimated error, ± 3σ", "m, left positive",
        field_of("tracking", "lateral_error_m"), field_of("tracking", "lateral_deviation_m"),
    ),
)
# fmt: on


def over_time(run: RunTables, name: str, quantity: Quantity, points: int) -> Curve:
    """Values over the time (s) after the start."""
    at, values = quantity.signal(run, name)
    return thinned(((at - run.beginning) / 1e9, values), points)


def over_place(run: RunTables, name: str, quantity: Quantity, points: int) -> Curve:
    """Values over the place (m) on the lead's path, where the vehicle is there first."""
    at, values = quantity.signal(run, name)
    known = Signal(run.table(name, "truth").at_ns, stations(run, name)).known
    if not len(known.at_ns):
        return np.zeros(0), np.zeros(0)
    station = np.interp(at, known.at_ns, known.values)
    first = np.diff(np.maximum.accumulate(station), prepend=-np.inf) > 0.0
    return thinned((station[first], values[first]), points)


def loss_shares(record: RunRecord, link: tuple[str, str], edges: Floats) -> Floats:
    """Share lost of the messages sent between `edges` (s); 0 where none was sent."""
    rows = record.outcomes(link)
    known = rows.outcome != "in_flight"
    lost = np.isin(rows.outcome, ("dropped", "not_arrived"))
    counts = np.histogram(rows.t_s[known], edges)[0]
    shares: Floats = np.histogram(rows.t_s[lost], edges)[0] / np.maximum(counts, 1)
    return shares


def vehicles_with_truth(record: RunRecord) -> list[str]:
    return [name for name in record.vehicle_names if "truth" in record.topics_of(name)]


def worst_vehicles(names: Sequence[str], summary: RunSummary, most: int) -> list[str]:
    """The first vehicle and those with the largest errors, in the order of the convoy."""
    errors = {row.name: row.cross_track_error_m_max or 0.0 for row in summary.vehicles}
    worst = sorted(names[1:], key=lambda name: -errors.get(name, 0.0))[: most - 1]
    return [name for name in names if name in {*names[:1], *worst}]


# ---- Figures


class Drawing:
    """Draws some vehicles of a run, each curve with at most `points`; `span` is in seconds."""

    def __init__(self, record: RunRecord, names: Sequence[str], points: int) -> None:
        """The log has true poses of the vehicles `names`."""
        self.record, self.run, self.names, self.points = record, record.tables, names, points
        times = [record.seconds(self.run.table(name, "truth").at_ns) for name in names]
        begin, end = min(at_s[0] for at_s in times), max(at_s[-1] for at_s in times)
        # A piece of a run begins later.
        self.span = (float(begin) if begin > 0.05 * end else 0.0, max(float(end), 0.1))

    def style(self, name: str) -> Any:
        return {"color": vehicle_colour(self.run.names.index(name)), "linewidth": 1.1}

    def plan(self, axes: Axes) -> None:
        for name in reversed(self.names):
            truth = self.run.table(name, "truth")
            rows = np.linspace(0, len(truth) - 1, min(self.points, len(truth))).astype(int)
            track = truth["east_m"][rows], truth["north_m"][rows]
            axes.plot(*track, label=name, **self.style(name))
        axes.set(xlabel="east, m", ylabel="north, m")
        axes.set_aspect("equal", adjustable="datalim")

    def curves(
        self, axes: Axes, quantity: Quantity, along: Callable[..., Curve] = over_time
    ) -> None:
        for name in self.names:
            curve, style = along(self.run, name, quantity, self.points), self.style(name)
            if quantity.deviation and curve[0].size:
                at, deviation = quantity.deviation(self.run, name)
                wide = 3.0 * np.interp(curve[0], (at - self.run.beginning) / 1e9, deviation)
                low, high = curve[1] - wide, curve[1] + wide
                axes.fill_between(
                    curve[0], low, high, alpha=0.18, linewidth=0, color=style["color"]
                )
            draw_curve(axes, curve, label=name, **style)
        axes.set_title(quantity.title, loc="left")
        axes.set_ylabel(quantity.unit)

    def strips(self) -> list[ModeStrip]:
        changes = {name: mode_changes(self.record.vehicles[name]) for name in self.names}
        return [
            ModeStrip(name, [*(one.at_s for one in of), self.span[1]], [one.mode for one in of])
            for name, of in changes.items()
        ]


@mpl.rc_context(STYLE)
def run_figure(record: RunRecord, names: Sequence[str]) -> Figure:
    """Draw paths, true errors, true gaps and speeds of vehicles for `run.plot()`."""
    figure = NotebookFigure(figsize=(PAGE_IN, 4.4), layout="constrained")
    (plan, errors), (speeds, gaps) = figure.subplots(2, 2)
    drawing = Drawing(record, names, PAGE_POINTS)
    drawing.plan(plan)
    for axes, quantity in zip((errors, gaps, speeds), QUANTITIES, strict=False):
        drawing.curves(axes, quantity)
        axes.set_xlabel("time, s")
    figure.legend(handles=plan.lines[::-1], loc="outside right upper")
    about = record.summary.identity
    figure.suptitle(fill(about.title or about.scenario, 90))
    return figure


def report_figures(record: RunRecord, summary: RunSummary) -> Iterator[tuple[str, str]]:
    """Yield titles and SVGs of the figures of a report: over time, by place, by frequency."""
    names = worst_vehicles(vehicles_with_truth(record), summary, MOST_CURVES)
    if not names:
        return
    drawing = Drawing(record, names, PAGE_POINTS // ((len(QUANTITIES) + 2) * len(names)))
    with mpl.rc_context(REPORT_STYLE):
        for title, figure in (
            ("Plan, north up", _plan_figure(drawing)),
            ("Over time", _time_figure(drawing, summary)),
            ("Along the path of the lead", _place_figure(drawing)),
            ("Gains from the vehicle ahead by frequency", _gain_figure(drawing)),
        ):
            if figure is not None:
                yield title, svg_of(figure)


def _plan_figure(drawing: Drawing) -> Figure:
    truths = [drawing.run.table(name, "truth") for name in drawing.names]
    wide, high = (
        max(float(np.ptp(np.concatenate([truth[axis] for truth in truths]))), 1.0)
        for axis in ("east_m", "north_m")
    )
    height = float(np.clip(WIDTH_IN * high / wide, 1.2, 4.5)) + 0.8
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes = figure.subplots()
    drawing.plan(axes)
    figure.legend(handles=axes.lines[::-1], loc="outside upper left", ncols=MOST_CURVES)
    return figure


def _time_figure(drawing: Drawing, summary: RunSummary) -> Figure:
    strips, span = drawing.strips(), drawing.span
    worst = sorted(summary.links, key=lambda row: -row.loss_ratio)[:MOST_LINKS]
    known = drawing.record.links
    links = [
        (row.sender, row.receiver)
        for row in summary.links
        if row in worst and row.loss_ratio > 0.0 and (row.sender, row.receiver) in known
    ]
    heights = [1.5] * len(QUANTITIES) + [0.35 + 0.14 * len(strips)]
    heights += [0.35 + 0.14 * len(links)] if links else []
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 0.9), layout="constrained")
    rows = figure.subplots(len(heights), 1, height_ratios=heights, sharex=True)
    for axes, quantity in zip(rows, QUANTITIES, strict=False):
        drawing.curves(axes, quantity)
    times = [event.at_s for event in summary.events if event.at_s <= span[1]]
    rows[0].plot(
        times, np.ones(len(times)), "v", color=RED, transform=rows[0].get_xaxis_transform()
    )
    draw_strips(rows[4], strips, span)
    rows[4].set_title("modes", loc="left")
    used = {mode for strip in strips for mode in strip.modes}
    patches = [Patch(color=MODE_COLOURS[mode], label=mode) for mode in MODE_COLOURS if mode in used]
    if links:
        cells = min(CELLS, max(int((span[1] - span[0]) / LEAST_CELL_S), 1))
        image = np.full((len(links), cells, 4), to_rgba(RED))
        edges = np.linspace(*span, cells + 1)
        for place, link in enumerate(links):
            image[place, :, 3] = loss_shares(drawing.record, link, edges)
        _draw_image(rows[5], image, [" → ".join(link) for link in links], span)
        rows[5].set_title("messages lost, stronger for a larger share", loc="left")
    figure.legend(handles=patches, loc="outside lower left", ncols=len(patches) or 1)
    rows[-1].set(xlabel="time, s", xlim=span)
    return figure


def _place_figure(drawing: Drawing) -> Figure | None:
    shown = [quantity for quantity in QUANTITIES if quantity.by_place]
    figure = Figure(figsize=(WIDTH_IN, 1.7 * len(shown) + 0.4), layout="constrained")
    rows = figure.subplots(len(shown), 1, sharex=True)
    for axes, quantity in zip(rows, shown, strict=True):
        drawing.curves(axes, quantity, over_place)
    rows[-1].set_xlabel("distance from the lead's start, m")
    return figure if any(axes.lines for axes in rows) else None


def _gain_figure(drawing: Drawing) -> Figure | None:
    tables = {signal: frequency_gains(drawing.run, signal) for signal in get_args(SignalName)}
    known = {signal: table for signal, table in tables.items() if len(table)}
    if not known:
        return None
    figure = Figure(figsize=(WIDTH_IN, 1.9 * len(known) + 0.3), layout="constrained")
    rows = figure.subplots(len(known), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (signal, table) in zip(rows, known.items(), strict=True):
        for name in drawing.names:
            own = table.vehicle == name
            curve = table.frequency_hz[own], table.gain[own]
            draw_curve(axes, curve, marker="o", markersize=3.0, **drawing.style(name))
        axes.axhline(1.0, color=SOFT, linewidth=0.8, linestyle="--")
        axes.set_title(f"{signal} gain, where the coherence is 0.95 or more", loc="left")
    rows[-1].set_xlabel("frequency, Hz")
    return figure


# ---- SVG inside of an HTML page, whose style sheet has its colours

INK, SOFT, GRID = "#1b1f24", "#59636e", "#e6eaee"
"""Colours of a figure that become those of the page, light or dark."""
REPORT_STYLE: Any = STYLE | {
    "text.color": INK,
    "axes.labelcolor": SOFT,
    "axes.edgecolor": SOFT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "grid.color": GRID,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "svg.fonttype": "none",
}


def svg_of(figure: Figure) -> str:
    """Encode a figure as an SVG element, in the colours of the page."""
    text = encoded(figure, "svg", REPORT_STYLE).decode()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r' xmlns(:\w+)?="[^"]*"| (width|height)="[\d.]+pt"', "", text)
    text = re.sub(r"(\d\.\d\d)\d+", r"\1", text)  # a hundredth of a point
    for colour, name in ((INK, "--ink"), (SOFT, "--soft"), (GRID, "--grid")):
        text = text.replace(colour, f"var({name})")
    # The font is that of the page, and names of groups would repeat in it.
    return re.sub(r"font-family: [^;]*; |(?<=<g) id=\"[^\"]*\"", "", text).strip()
