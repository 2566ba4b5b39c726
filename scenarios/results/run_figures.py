"""Figures of a run: plan, curves over time and path, modes, losses and gains.

`run.plot()`, the HTML report and comparisons draw with the same functions and colours.
"""

import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import fill
from typing import Any

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
from scenarios.results.frequency_gains import Signal, frequency_gains
from scenarios.results.run_record import RunRecord
from scenarios.results.summary import RunSummary
from transport.columns import Columns
from transport.log.reader import LogReader

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


# ---- Curves of a run


@dataclass(frozen=True, slots=True)
class Quantity:
    """A plotted quantity of each vehicle: its title, unit, topic and field in the log."""

    title: str
    unit: str
    topic: str
    field: str
    deviation: str = ""
    by_place: bool = False


QUANTITIES = (
    Quantity(
        "true error from the lead's path", "m, left positive", "deviation", "cross_track_error_m",
        by_place=True,
    ),
    Quantity(
        "true gap to the vehicle ahead", "m, bumper to bumper", "deviation", "true_gap_m",
        by_place=True,
    ),
    Quantity("speed", "m/s", "truth", "speed_mps"),
    Quantity(
        "self-estimated error, ± 3σ", "m, left positive", "tracking", "lateral_error_m",
        "lateral_deviation_m",
    ),
)  # fmt: skip


FIELDS: Mapping[str, Sequence[str]] = {
    "truth": ("east_m", "north_m", "distance_m", "speed_mps"),
    "deviation": ("cross_track_error_m", "true_gap_m"),
    "tracking": ("lateral_error_m", "lateral_deviation_m", "mode"),
    "gps": ("seq",),
    "verdict": ("sender", "pose_seq", "outcome"),
}
"""Fields that are drawn, by topic."""


class RunCurves:
    """Curves of some vehicles of a run, thinned to `points` each; `span` is their time (s)."""

    def __init__(self, record: RunRecord, names: Sequence[str], points: int) -> None:
        """Read the log; it has true poses of the vehicles `names`."""
        self.record, self.names, self._points = record, names, points
        self.convoy = list(record.vehicle_names)
        read = LogReader(record.log).columns(FIELDS, fields=FIELDS)
        self._columns = {key: _in_order(columns) for key, columns in read.items()}
        times = [record.seconds(self._columns[name, "truth"].at_ns) for name in names]
        begin, end = min(at_s.min() for at_s in times), max(at_s.max() for at_s in times)
        # A piece of a run begins later.
        self.span = (float(begin) if begin > 0.05 * end else 0.0, max(float(end), 0.1))

    def _read(self, vehicle: str, topic: str, name: str) -> tuple[NDArray[np.int64], NDArray[Any]]:
        """Instants (ns) and values of a field; none without messages."""
        columns = self._columns.get((vehicle, topic))
        if columns is None:
            return np.zeros(0, np.int64), np.zeros(0)
        return columns.at_ns, columns[name]

    def track(self, name: str) -> tuple[Floats, Floats]:
        """East and north (m), evenly thinned."""
        truth = self._columns[name, "truth"]
        rows = np.linspace(0, len(truth) - 1, min(self._points, len(truth))).astype(int)
        return truth["east_m"][rows], truth["north_m"][rows]

    def colour(self, name: str) -> str:
        return vehicle_colour(self.convoy.index(name))

    def over_time(self, name: str, quantity: Quantity) -> tuple[Curve, Floats]:
        """Values over time (s), and the standard deviations at the same instants, if any."""
        at_ns, values = self._read(name, quantity.topic, quantity.field)
        at_s = self.record.seconds(at_ns)
        curve = thinned((at_s, values), self._points)
        if not quantity.deviation or not at_s.size:
            return curve, np.zeros(0)
        _, deviation = self._read(name, quantity.topic, quantity.deviation)
        return curve, np.interp(curve[0], at_s, deviation)

    def by_place(self, name: str, quantity: Quantity) -> Curve:
        """Values over the distance (m) from the lead's start, where the vehicle is there first."""
        scenario = self.record.known_scenario
        at_ns, values = self._read(name, quantity.topic, quantity.field)
        if scenario is None or not at_ns.size:
            return np.zeros(0), np.zeros(0)
        behind = scenario.route.start - scenario.route.start_station(self.convoy.index(name))
        station = np.interp(at_ns, *self._read(name, "truth", "distance_m")) - behind
        first = np.diff(np.maximum.accumulate(station), prepend=-np.inf) > 0.0
        return thinned((station[first], values[first]), self._points)

    def modes(self, name: str) -> ModeStrip:
        at_ns, modes = self._read(name, "tracking", "mode")
        changed = np.flatnonzero(modes[1:] != modes[:-1]) + 1
        starts = [0, *changed.tolist()] if modes.size else []
        edges = [*self.record.seconds(at_ns[starts]).tolist(), self.span[1]]
        return ModeStrip(name, edges, modes[starts].tolist())

    def loss_shares(self, link: tuple[str, str], in_flight: int, cells: int) -> Floats:
        """Share lost of the messages sent in each cell of the time; 0 where none was sent."""
        sent_at, numbers = self._read(link[0], "gps", "seq")
        verdicts = self._columns.get((link[1], "verdict"))
        delivered: NDArray[np.int64] = np.zeros(0, np.int64)
        if verdicts is not None:
            rows = (verdicts["sender"] == link[0]) & (verdicts["outcome"] == "delivered")
            delivered = verdicts["pose_seq"][rows]
        known = max(len(numbers) - in_flight, 0)
        at_s = self.record.seconds(sent_at[:known])
        lost = ~np.isin(numbers[:known], delivered)
        counts = np.histogram(at_s, cells, self.span)[0]
        shares: Floats = np.histogram(at_s[lost], cells, self.span)[0] / np.maximum(counts, 1)
        return shares


def _in_order(columns: Columns) -> Columns:
    """Sort messages by their instant."""
    if (np.diff(columns.at_ns) >= 0).all():  # the usual case
        return columns
    return columns.of(np.argsort(columns.at_ns, kind="stable"))


def vehicles_with_truth(record: RunRecord) -> list[str]:
    return [name for name in record.vehicle_names if "truth" in record.topics_of(name)]


def worst_vehicles(names: Sequence[str], summary: RunSummary, most: int) -> list[str]:
    """The first vehicle and those with the largest errors, in the order of the convoy."""
    errors = {row.name: row.cross_track_error_m_max or 0.0 for row in summary.vehicles}
    worst = sorted(names[1:], key=lambda name: -errors.get(name, 0.0))[: most - 1]
    return [name for name in names if name in {*names[:1], *worst}]


# ---- Figures


@mpl.rc_context(STYLE)
def run_figure(record: RunRecord, names: Sequence[str]) -> Figure:
    """Draw paths, true errors, true gaps and speeds of vehicles for `run.plot()`."""
    figure = NotebookFigure(figsize=(PAGE_IN, 4.4), layout="constrained")
    (plan, errors), (speeds, gaps) = figure.subplots(2, 2)
    for name in names:
        true = record.vehicles[name].true
        style = {"color": vehicle_colour(list(record.vehicle_names).index(name)), "linewidth": 1.1}
        plan.plot(true.east_m, true.north_m, label=name, **style)
        draw_curve(errors, (true.t_s, true.error_m), **style)
        draw_curve(speeds, (true.t_s, true.speed_mps), **style)
        draw_curve(gaps, (true.t_s, true.gap_m), **style)
    plan.set(xlabel="east, m", ylabel="north, m")
    plan.set_aspect("equal", adjustable="datalim")
    for axes, quantity in zip((errors, gaps, speeds), QUANTITIES, strict=False):
        axes.set(xlabel="time, s", ylabel=quantity.unit)
        axes.set_title(quantity.title, loc="left")
    figure.legend(handles=plan.lines, loc="outside right upper")
    about = record.summary.identity
    figure.suptitle(fill(about.title or about.scenario, 90))
    return figure


def report_figures(record: RunRecord, summary: RunSummary) -> Iterator[tuple[str, str]]:
    """Yield titles and SVGs of the figures of a report: over time, by place, by frequency."""
    names = worst_vehicles(vehicles_with_truth(record), summary, MOST_CURVES)
    if not names:
        return
    quantities = len(QUANTITIES) + 2
    curves = RunCurves(record, names, points=PAGE_POINTS // (quantities * len(names)))
    with mpl.rc_context(REPORT_STYLE):
        yield "Plan, north up", svg_of(_plan_figure(curves))
        yield "Over time", svg_of(_time_figure(curves, summary))
        if figure := _place_figure(curves):
            yield "Along the path of the lead", svg_of(figure)
        del curves  # the gains read other columns
        if figure := _gain_figure(record, names):
            yield "Gains from the vehicle ahead by frequency", svg_of(figure)


def _draw_plan(axes: Axes, curves: RunCurves) -> None:
    for name in reversed(curves.names):
        axes.plot(*curves.track(name), label=name, color=curves.colour(name), linewidth=1.1)
    axes.set(xlabel="east, m", ylabel="north, m")
    axes.set_aspect("equal", adjustable="datalim")


def _draw_quantity(axes: Axes, curves: RunCurves, quantity: Quantity) -> None:
    for name in curves.names:
        curve, deviation = curves.over_time(name, quantity)
        style = {"color": curves.colour(name), "linewidth": 1.1}
        if np.isfinite(deviation).any():
            low, high = curve[1] - 3.0 * deviation, curve[1] + 3.0 * deviation
            axes.fill_between(curve[0], low, high, alpha=0.18, linewidth=0, color=style["color"])
        draw_curve(axes, curve, label=name, **style)
    axes.set_title(quantity.title, loc="left")
    axes.set_ylabel(quantity.unit)


def _plan_figure(curves: RunCurves) -> Figure:
    points = np.concatenate([np.stack(curves.track(name)) for name in curves.names], axis=1)
    wide, high = np.maximum(np.ptp(points, axis=1), 1.0).tolist()
    height = float(np.clip(WIDTH_IN * high / wide, 1.2, 4.5)) + 0.8
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    axes = figure.subplots()
    _draw_plan(axes, curves)
    figure.legend(handles=axes.lines[::-1], loc="outside upper left", ncols=MOST_CURVES)
    return figure


def _time_figure(curves: RunCurves, summary: RunSummary) -> Figure:
    strips = [curves.modes(name) for name in curves.names]
    cells = min(CELLS, max(int((curves.span[1] - curves.span[0]) / LEAST_CELL_S), 1))
    worst = sorted(summary.links, key=lambda row: -row.loss_ratio)[:MOST_LINKS]
    links = [row for row in summary.links if row in worst and row.loss_ratio > 0.0]
    heights = [1.5] * len(QUANTITIES) + [0.35 + 0.14 * len(strips)]
    heights += [0.35 + 0.14 * len(links)] if links else []
    size = (WIDTH_IN, sum(heights) + 0.9)
    figure = Figure(figsize=size, layout="constrained")
    rows = figure.subplots(len(heights), 1, height_ratios=heights, sharex=True)
    for axes, quantity in zip(rows, QUANTITIES, strict=False):
        _draw_quantity(axes, curves, quantity)
    times = [event.at_s for event in summary.events if event.at_s <= curves.span[1]]
    rows[0].plot(
        times, np.ones(len(times)), "v", color=RED, transform=rows[0].get_xaxis_transform()
    )
    draw_strips(rows[4], strips, curves.span)
    rows[4].set_title("modes", loc="left")
    used = {mode for strip in strips for mode in strip.modes}
    patches = [Patch(color=MODE_COLOURS[mode], label=mode) for mode in MODE_COLOURS if mode in used]
    if links:
        image = np.zeros((len(links), cells, 4))
        image[:, :] = to_rgba(RED)
        for place, row in enumerate(links):
            link = row.sender, row.receiver
            image[place, :, 3] = curves.loss_shares(link, row.in_flight, cells)
        labels = [f"{row.sender} → {row.receiver}" for row in links]
        _draw_image(rows[5], image, labels, curves.span)
        rows[5].set_title("messages lost, stronger for a larger share", loc="left")
    figure.legend(handles=patches, loc="outside lower left", ncols=len(patches) or 1)
    rows[-1].set(xlabel="time, s", xlim=curves.span)
    return figure


def _place_figure(curves: RunCurves) -> Figure | None:
    shown = [quantity for quantity in QUANTITIES if quantity.by_place]
    figure = Figure(figsize=(WIDTH_IN, 1.7 * len(shown) + 0.4), layout="constrained")
    rows = figure.subplots(len(shown), 1, sharex=True)
    for axes, quantity in zip(rows, shown, strict=True):
        for name in curves.names:
            curve = curves.by_place(name, quantity)
            draw_curve(axes, curve, color=curves.colour(name), linewidth=1.1)
        axes.set_title(quantity.title, loc="left")
        axes.set_ylabel(quantity.unit)
    rows[-1].set_xlabel("distance from the lead's start, m")
    return figure if any(axes.lines for axes in rows) else None


def _gain_figure(record: RunRecord, names: Sequence[str]) -> Figure | None:
    signals: tuple[Signal, ...] = ("speed", "spacing")
    tables = {signal: frequency_gains(record, signal) for signal in signals}
    known = {signal: table for signal, table in tables.items() if len(table)}
    if not known:
        return None
    figure = Figure(figsize=(WIDTH_IN, 1.9 * len(known) + 0.3), layout="constrained")
    rows = figure.subplots(len(known), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (signal, table) in zip(rows, known.items(), strict=True):
        for place, name in enumerate(record.vehicle_names):
            own = (table.vehicle == name) & (name in names)
            curve = table.frequency_hz[own], table.gain[own]
            draw_curve(axes, curve, color=vehicle_colour(place), marker="o", markersize=3.0)
        axes.axhline(1.0, color=SOFT, linewidth=0.8, linestyle="--")
        axes.set_title(f"{signal} gain, where the coherence is 0.95 or more", loc="left")
    rows[-1].set_xlabel("frequency, Hz")
    return figure


# ---- SVG inside of an HTML page, whose style sheet has its colours

WIDTH_IN = 9.0
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
