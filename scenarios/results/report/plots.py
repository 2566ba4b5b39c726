"""Pictures of a run as inline SVG: plan, curves over time, strips of modes and losses.

The script of the page reads the curves back from their paths: `data-` attributes hold the scales.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.results.data_table import DataTable
from scenarios.results.frequency_gains import Signal, frequency_gains
from scenarios.results.report.tables import Markup, element, join
from scenarios.results.run_record import ModeFrom, RunRecord, mode_changes
from scenarios.results.summary import RunSummary
from transport.panels import PANELS, Colour, colour_of

# ---- Scales and ticks of the plots


Floats = NDArray[np.float64]
MARGIN_RATIO = 0.06
STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Scale:
    """Linear map from values `low` to `high` to pixels `first` to `last`."""

    low: float
    high: float
    first: float
    last: float

    def to_pixels(self, values: Floats) -> Floats:
        span = (self.high - self.low) or 1.0
        pixels: Floats = self.first + (values - self.low) / span * (self.last - self.first)
        return pixels

    def pixel(self, value: float) -> float:
        return float(self.to_pixels(np.array([value]))[0])

    def ticks(self, count: int) -> list[float]:
        """About `count` multiples of 1, 2 or 5 times a power of ten within the range."""
        span = self.high - self.low
        if not span > 0.0:
            return [self.low]
        raw = span / count
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(factor * power for factor in STEPS if factor * power >= raw * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        last = math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def value_range(values: list[Floats]) -> tuple[float, float]:
    """Range of all finite values and zero, with a margin."""
    finite = [part[np.isfinite(part)] for part in values]
    known = np.concatenate([np.zeros(1), *finite])
    low, high = float(known.min()), float(known.max())
    margin = MARGIN_RATIO * ((high - low) or 1.0)
    return (low - margin if low < 0.0 else low), high + margin


def thinned(at: Floats, values: Floats, most: int) -> tuple[Floats, Floats]:
    """Keep the least and the largest value of each of `most` / 2 equal parts, and the ends.

    Extremes are kept exactly. NaN is kept as a break of the line.
    """
    if at.size <= most:
        return at, values
    width = -(-at.size // max(most // 2, 1))
    parts = -(-at.size // width)
    padded = np.full(parts * width, np.inf)
    padded[: at.size] = values
    table = padded.reshape(parts, width)
    unknown = np.isnan(table)
    first = np.arange(parts) * width
    least = first + np.where(unknown, np.inf, table).argmin(axis=1)
    largest = first + np.where(unknown | np.isinf(table), -np.inf, table).argmax(axis=1)
    breaks = (first + unknown.argmax(axis=1))[unknown.any(axis=1)]
    rows = np.unique(np.concatenate([[0, at.size - 1], least, largest, breaks]))
    return at[rows], values[rows]


# ---- Curves of the plots: over time or along the path of the lead, with bands of three sigma


@dataclass(frozen=True, slots=True)
class Axis:
    """The horizontal axis of a plot: a name and its scale."""

    name: str
    scale: Scale

    @property
    def data(self) -> dict[str, object]:
        """Attributes by which the script of the page finds values under the cursor."""
        low, high = f"{self.scale.low:.9g}", f"{self.scale.high:.9g}"
        return {"data_axis": self.name, "data_from": low, "data_to": high}


@dataclass(frozen=True, slots=True)
class VehicleCurve:
    """Values of one vehicle over time (s), place (m) or frequency (Hz).

    The `deviation` makes a band, `points` are drawn as such.
    """

    name: str
    at: Floats
    values: Floats
    deviation: Floats | None = None
    points: bool = False

    @property
    def is_known(self) -> bool:
        return bool(np.isfinite(self.values).any())

    def band(self) -> tuple[Floats, Floats] | None:
        """Values three standard deviations below and above; None without any."""
        if self.deviation is None or not np.isfinite(self.deviation).any():
            return None
        return self.values - 3.0 * self.deviation, self.values + 3.0 * self.deviation


def along_path(name: str, true: DataTable, figure: str) -> VehicleCurve:
    """A figure over the place along the path of the lead, where the vehicle is there first."""
    known = np.flatnonzero(np.isfinite(true.station_m))
    station = true.station_m[known]
    first = np.diff(np.maximum.accumulate(station), prepend=-np.inf) > 0.0
    return VehicleCurve(name, station[first], true[figure][known][first])


def path_data(x: Floats, y: Floats) -> str:
    """Path of a line in SVG, interrupted where a value is unknown."""
    parts: list[str] = []
    pen = "M"
    for px, py in zip(x.tolist(), y.tolist(), strict=True):
        if not (np.isfinite(px) and np.isfinite(py)):
            pen = "M"
            continue
        parts.append(f"{pen}{px:.1f} {py:.1f}")
        pen = "L"
    return "".join(parts)


def band_data(axis: Axis, scale: Scale, curve: VehicleCurve, most: int) -> str:
    """Area of the band of a curve in SVG, with up to `most` points a side; empty without one.

    Each side keeps its extremes, so that a narrower picture does not narrow the band.
    """
    sides = curve.band()
    if sides is None:
        return ""
    known = np.isfinite(sides[0])
    parts = []
    for rows in np.split(
        np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 1) + 1
    ):
        share = max(int(most * rows.size / known.sum()), 8)
        lines = []
        for side, order in zip(sides, (1, -1), strict=True):
            at, values = thinned(curve.at[rows], side[rows], share)
            x, y = axis.scale.to_pixels(at), np.clip(scale.to_pixels(values), -1e4, 1e4)
            lines.append(path_data(x[::order], y[::order]))
        parts.append(f"{lines[0]}L{lines[1][1:]}z")
    return "".join(parts)


# ---- Plots


WIDTH, LEFT, RIGHT = 900.0, 58.0, 8.0
TOP, BOTTOM = 8.0, 24.0
PLOT_HEIGHT, PLAN_HEIGHT = 170.0, (120.0, 420.0)
STRIP_HEIGHT = 16.0
LEAST_POINTS, MOST_POINTS = 40, 700
"""Points of one curve."""
CURVES_OF_VEHICLE = 8
"""Curves over time and place, and two sides of a band."""
MODE_CELLS = 300
"""Parts of the time in which one mode of a vehicle is drawn, if it changes more often."""
ERROR, LEFT_POSITIVE = "True error from the lead's path", "m, left positive"
SPEED_GAIN, SPACING_GAIN = "Speed gain", "Spacing error gain"
GAIN_UNIT = "from the vehicle ahead, where that is excited and the coherence is 0.95 or more"
GAP, BUMPERS = "True gap to the vehicle ahead", "m, bumper to bumper"
PLAN_POINTS = 200
LOSS_CELLS, LEAST_CELL_S = 150, 0.5
"""Parts of the run whose loss is shown, and their least duration."""


Span = tuple[float, float]
"""Begin and end of a time (s)."""


class TimeMark(NamedTuple):
    """A text about a time (s)."""

    at_s: float
    text: str


def colour_code(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


class ReportDetail(NamedTuple):
    """How much a report shows.

    Points of all curves, vehicles with curves, links with strips, and rows of a table.
    """

    points: int
    vehicles: int
    strips: int
    rows: int


class RunPlots:
    """The pictures of one run, over time and along the path of the lead."""

    def __init__(
        self,
        record: RunRecord,
        summary: RunSummary,
        detail: ReportDetail,
        marks: Sequence[TimeMark] = (),
    ) -> None:
        """`marks` are drawn above the curves."""
        self._record = record
        self._detail = detail
        self._marks = marks
        self._ran_s = max(summary.ran_s, 0.1)
        self._time = Axis("time", Scale(*self._times(), LEFT, WIDTH - RIGHT))
        known = [
            name for name in record.vehicle_names if len(record.columns_of("truth").get(name, ()))
        ]
        self._names = _worst(known, summary, detail.vehicles)
        self.left_out = len(known) - len(self._names)
        """Vehicles without curves, those with the smallest errors."""
        count = max(len(self._names) * CURVES_OF_VEHICLE, 1)
        self._points = min(max(detail.points // count, LEAST_POINTS), MOST_POINTS)

    def _times(self) -> tuple[float, float]:
        """First and last time (s) of the pictures; a piece begins later than the run."""
        truth = self._record.columns_of("truth").values()
        firsts = [self._record.seconds(rows.at_ns[:1])[0] for rows in truth if len(rows)]
        begin = float(min(firsts, default=0.0))
        begin = begin if begin > 0.05 * self._ran_s else 0.0
        return begin, begin + self._ran_s

    @property
    def is_empty(self) -> bool:
        return not self._names

    def figures(self) -> Iterator[Markup]:
        """Yield all pictures over time, with their titles."""
        yield _figure("Plan", "north up", self._plan())
        for title, unit, name in (
            (ERROR, LEFT_POSITIVE, "error_m"),
            (GAP, BUMPERS, "gap_m"),
            ("Speed", "m/s", "speed_mps"),
        ):
            tables = {vehicle: self._record.vehicles[vehicle].true for vehicle in self._names}
            curves = [
                VehicleCurve(vehicle, true.t_s, true[name]) for vehicle, true in tables.items()
            ]
            yield from self._plot(title, unit, name, curves, self._time)
        own = [self._own_error(name) for name in self._names]
        title = PANELS["tracking"].title
        yield from self._plot(title, LEFT_POSITIVE, "own_m", list(filter(None, own)), self._time)
        yield _figure("Modes", "of each vehicle", self._modes())
        if losses := self._losses():
            yield _figure("Messages lost", "of each link, stronger for a larger share", losses)

    def figures_along_path(self) -> Iterator[Markup]:
        """Yield the pictures over the place on the path of the lead, with their titles."""
        tables = {vehicle: self._record.vehicles[vehicle].true for vehicle in self._names}
        for title, unit, name in ((ERROR, LEFT_POSITIVE, "error_m"), (GAP, BUMPERS, "gap_m")):
            curves = [along_path(vehicle, true, name) for vehicle, true in tables.items()]
            known = [curve for curve in curves if curve.is_known]
            if known:
                low = min(float(curve.at[0]) for curve in known)
                high = max(float(curve.at[-1]) for curve in known)
                axis = Axis("place", Scale(low, max(high, low + 1.0), LEFT, WIDTH - RIGHT))
                yield from self._plot(title, unit, name, known, axis)

    def gain_figures(self) -> Iterator[Markup]:
        """Yield the pictures of gains over the frequency, where vehicles are excited."""
        signals: Mapping[Signal, str] = {"speed": SPEED_GAIN, "spacing": SPACING_GAIN}
        tables = {signal: frequency_gains(self._record, signal) for signal in signals}
        known = [table.frequency_hz for table in tables.values() if len(table)]
        if not known:
            return
        axis = Axis("frequency", Scale(0.0, 1.1 * max(map(max, known)), LEFT, WIDTH - RIGHT))
        for signal, table in tables.items():
            rows = {name: np.flatnonzero(table.vehicle == name) for name in self._names}
            curves = [
                VehicleCurve(name, table.frequency_hz[own], table.gain[own], points=True)
                for name, own in rows.items()
                if own.size
            ]
            yield from self._plot(signals[signal], GAIN_UNIT, f"{signal}_gain", curves, axis)

    def legend(self) -> Markup:
        """Names of the vehicles in their colours."""
        return element(
            "p",
            *(
                element("span", name, class_="key", style=f"--key:{self._colour(name)}")
                for name in self._names
            ),
            class_="legend",
        )

    def _colour(self, name: str) -> str:
        return colour_code(colour_of(list(self._record.vehicle_names).index(name)))

    def _own_error(self, vehicle: str) -> VehicleCurve | None:
        if "tracking" not in self._record.topics_of(vehicle):
            return None
        own = self._record.vehicles[vehicle].tracking
        return VehicleCurve(vehicle, own.t_s, own.lateral_error_m, own.lateral_deviation_m)

    # ---- Curves

    def _plot(
        self, title: str, unit: str, name: str, curves: Sequence[VehicleCurve], axis: Axis
    ) -> Iterator[Markup]:
        """Yield a picture of the known curves, if there are any."""
        known = [curve for curve in curves if curve.is_known]
        if not known:
            return
        height = PLOT_HEIGHT
        bands = [side for curve in known for side in curve.band() or ()]
        shown = [np.ones(1)] if axis.name == "frequency" else []
        low, high = value_range([*(curve.values for curve in known), *bands, *shown])
        scale = Scale(low, high, height - BOTTOM, TOP)
        areas, lines = [], []
        for curve in known:
            at, values = thinned(curve.at, curve.values, self._points)
            d = path_data(axis.scale.to_pixels(at), scale.to_pixels(values))
            style = {"stroke": self._colour(curve.name), "data_name": curve.name}
            lines.append(element("path", class_="curve", d=d, **style))
            if curve.points:
                dots = zip(axis.scale.to_pixels(at), scale.to_pixels(values), strict=True)
                lines += [
                    element("circle", r=3, cx=f"{x:.1f}", cy=f"{y:.1f}", fill=style["stroke"])
                    for x, y in dots
                ]
            if area := band_data(axis, scale, curve, self._points // 2):
                areas.append(element("path", class_="band", d=area, fill=style["stroke"]))
        picture = self._svg(
            height,
            *self._grid(height, axis, scale),
            *areas,
            *lines,
            *self._drawn_marks(axis, scale),
            kind="plot",
            axis=axis,
            data_quantity=name,
            data_low=f"{low:.9g}",
            data_high=f"{high:.9g}",
        )
        yield _figure(title, unit, picture)

    def _drawn_marks(self, axis: Axis, scale: Scale) -> Iterator[Markup]:
        """Yield events over time, and the gain of 1 over the frequency."""
        if axis.name == "frequency":
            y = scale.pixel(1.0)
            yield _line(LEFT, y, WIDTH - RIGHT, y, "zero bound")
        for mark in self._marks if axis is self._time else ():
            x = self._pixel(mark.at_s)
            title = element("title", f"{mark.at_s:.2f} s: {mark.text}")
            d = f"M{x:.1f} {TOP + 8:g}l-4.5 -8h9z"
            yield element("path", title, d=d, class_="mark")

    def _pixel(self, at_s: float) -> float:
        """Pixel of a time, at most at the end of the axis."""
        scale = self._time.scale
        return scale.pixel(min(max(at_s, scale.low), scale.high))

    def _grid(self, height: float, axis: Axis, scale: Scale | None = None) -> Iterator[Markup]:
        bottom = height - BOTTOM
        for value in axis.scale.ticks(8):
            x = axis.scale.pixel(value)
            yield _line(x, TOP, x, bottom)
            yield element("text", f"{value:g}", x=f"{x:.1f}", y=f"{height - 8:.1f}", class_="x")
        for value in scale.ticks(4) if scale else ():
            y = scale.pixel(value) if scale else 0.0
            yield _line(LEFT, y, WIDTH - RIGHT, y, "zero" if abs(value) < 1e-12 else "grid")
            text = f"{value + 0.0:.6g}"
            yield element("text", text, x=f"{LEFT - 6:.1f}", y=f"{y + 4:.1f}", class_="y")

    def _svg(
        self, height: float, *content: Markup, kind: str, axis: Axis, **data: object
    ) -> Markup:
        cursor = element("line", class_="cursor", x1=0, x2=0, y1=TOP, y2=f"{height - BOTTOM:.1f}")
        return element(
            "svg",
            *content,
            cursor,
            viewBox=f"0 0 {WIDTH:g} {height:g}",
            class_=kind,
            role="img",
            **axis.data,
            **data,
        )

    # ---- Strips

    def _modes(self) -> Markup:
        states = PANELS["mode"].states
        height = TOP + STRIP_HEIGHT * len(self._names) + BOTTOM
        content = list(self._grid(height, self._time))
        used: dict[str, None] = {}
        for row, name in enumerate(self._names):
            changes = mode_changes(self._record.vehicles[name])
            content.append(_row_name(name, row))
            for mode, times in _spans(changes, self._time.scale).items():
                used[mode] = None
                colour = colour_code(states[mode])
                content.append(self._cells(row, times, f"{name}: {mode}", fill=colour))
        key = element(
            "p",
            *(
                element("span", mode, class_="key", style=f"--key:{colour_code(states[mode])}")
                for mode in states
                if mode in used
            ),
            class_="legend",
        )
        return join(self._svg(height, *content, kind="strips", axis=self._time), key)

    def _cells(self, row: int, spans: Sequence[Span], title: str, **style: object) -> Markup:
        """Draw the times (s) of a row with one style as one path."""
        top, height = TOP + STRIP_HEIGHT * row, STRIP_HEIGHT - 2.0
        parts = []
        for begin, end in spans:
            first, last = self._pixel(begin), self._pixel(end)
            width = max(last - first, 0.4)
            parts.append(f"M{first:.1f} {top:g}h{width:.1f}v{height:g}h-{width:.1f}z")
        return element("path", element("title", title), d="".join(parts), **style)

    def _losses(self) -> Markup | None:
        """Strips of the share of messages lost; None if all links delivered everything."""
        cell_s = max(self._ran_s / LOSS_CELLS, LEAST_CELL_S)
        begin_s = self._time.scale.low
        shares = {link: self._shares(link, cell_s) for link in self._record.links}
        worst = sorted(shares, key=lambda link: -float(np.nansum(shares[link])))[
            : self._detail.strips
        ]
        shown = [link for link in shares if link in worst]
        if not any(float(np.nansum(shares[link])) > 0.0 for link in shown):
            return None
        height = TOP + STRIP_HEIGHT * len(shown) + BOTTOM
        content = list(self._grid(height, self._time))
        for row, (sender, receiver) in enumerate(shown):
            content.append(_row_name(f"{sender} → {receiver}", row))
            values = shares[sender, receiver]
            edges = np.flatnonzero(np.diff(values, prepend=-1.0, append=-1.0) != 0.0).tolist()
            spans: dict[float, list[Span]] = {}
            for first, last in pairwise(edges):
                span = begin_s + first * cell_s, begin_s + last * cell_s
                spans.setdefault(float(values[first]), []).append(span)
            for share, times in spans.items():
                if share > 0.0:
                    title = f"{sender} → {receiver}: {share:.0%} lost"
                    opacity = f"{share:.1f}"
                    content.append(self._cells(row, times, title, class_="loss", opacity=opacity))
        return self._svg(height, *content, kind="strips", axis=self._time)

    def _shares(self, link: tuple[str, str], cell_s: float) -> Floats:
        """Share lost of the messages sent in each part of the run, to a tenth; 0 without any."""
        outcomes = self._record.links[link].outcomes
        cells = np.floor((outcomes.t_s - self._time.scale.low) / cell_s).astype(int)
        count = int(np.ceil(self._ran_s / cell_s)) + 1
        inside = (cells >= 0) & (cells < count)
        sent = np.bincount(cells[inside], minlength=count)
        lost = np.isin(outcomes.outcome, ("dropped", "not_arrived")) & inside
        missing = np.bincount(cells[lost], minlength=count)
        shares: Floats = np.ceil(10.0 * missing / np.maximum(sent, 1)) / 10.0
        return shares

    # ---- Plan

    def _plan(self) -> Markup:
        times = np.linspace(self._time.scale.low, self._time.scale.high, PLAN_POINTS)
        tracks = {name: self._track(name, times) for name in self._names}
        points = np.concatenate([np.stack(track) for track in tracks.values()], axis=1)
        points = points[:, np.isfinite(points).all(axis=0)]
        least, most = points.min(axis=1), points.max(axis=1)
        span = np.maximum(most - least, 1.0)
        room = WIDTH - LEFT - RIGHT
        unit = min(room / float(span[0]), (PLAN_HEIGHT[1] - TOP - BOTTOM) / float(span[1]))
        height = max(unit * float(span[1]) + TOP + BOTTOM + 24.0, PLAN_HEIGHT[0])
        middle = 0.5 * (least + most)
        x0, y0 = LEFT + 0.5 * room, 0.5 * (height - BOTTOM + TOP)
        paths, dots = [], []
        for name, (east, north) in tracks.items():
            x, y = x0 + unit * (east - middle[0]), y0 - unit * (north - middle[1])
            colour = self._colour(name)
            paths.append(
                element("path", class_="track", d=path_data(x, y), stroke=colour, data_name=name)
            )
            dots.append(
                element("circle", r=5, cx=-20, cy=-20, fill=colour, class_="dot", data_name=name)
            )
        bar_m = _round_length(0.2 * room / unit)
        bar = element(
            "path",
            class_="bar",
            d=f"M{LEFT:.1f} {height - 10:.1f}h{bar_m * unit:.1f}",
        )
        text = element(
            "text",
            f"{bar_m:g} m",
            x=f"{LEFT + bar_m * unit + 6:.1f}",
            y=f"{height - 6:.1f}",
            class_="bar",
        )
        return element(
            "svg",
            *reversed(paths),
            *reversed(dots),
            bar,
            text,
            viewBox=f"0 0 {WIDTH:g} {height:.0f}",
            class_="plan",
            role="img",
            **self._time.data,
        )

    def _track(self, name: str, times: Floats) -> tuple[Floats, Floats]:
        """East and north (m) at times (s); before the first and after the last pose as there."""
        true = self._record.vehicles[name].true
        return np.interp(times, true.t_s, true.east_m), np.interp(times, true.t_s, true.north_m)


def _worst(names: Sequence[str], summary: RunSummary, most: int) -> list[str]:
    """The first vehicle and those with the largest errors, in the order of the convoy."""
    errors = {row.name: row.cross_track_error_m_max or 0.0 for row in summary.vehicles}
    worst = sorted(names[1:], key=lambda name: -errors.get(name, 0.0))[: most - 1]
    return [name for name in names if name in {*names[:1], *worst}]


def _spans(changes: Sequence[ModeFrom], scale: Scale) -> dict[str, list[Span]]:
    """Times (s) of each mode.

    Of very many changes only one mode is kept in each part of the time, the rarest of the vehicle.
    """
    edges = [change.at_s for change in changes] + [scale.high]
    spans: dict[str, list[Span]] = {}
    for (begin, end), change in zip(pairwise(edges), changes, strict=False):
        spans.setdefault(change.mode, []).append((begin, end))
    if len(changes) <= MODE_CELLS:
        return spans
    parts = np.linspace(scale.low, scale.high, MODE_CELLS + 1)
    chosen = np.full(MODE_CELLS, "", object)
    by_share = sorted(spans, key=lambda mode: -sum(end - begin for begin, end in spans[mode]))
    for mode in by_share:
        begins, ends = np.searchsorted(parts, np.array(spans[mode])).T.tolist()
        for first, last in zip(begins, ends, strict=True):
            chosen[max(first - 1, 0) : max(last, 1)] = mode
    firsts = [0, *(np.flatnonzero(chosen[1:] != chosen[:-1]) + 1).tolist(), MODE_CELLS]
    kept: dict[str, list[Span]] = {}
    for first, last in pairwise(firsts):
        kept.setdefault(chosen[first], []).append((float(parts[first]), float(parts[last])))
    return {mode: times for mode, times in kept.items() if mode}


def _round_length(metres: float) -> float:
    power = 10.0 ** np.floor(np.log10(max(metres, 1e-3)))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= metres * 1.0001))


def _figure(title: str, unit: str, picture: Markup) -> Markup:
    caption = element("figcaption", element("b", title), f" ({unit})")
    return element("figure", caption, picture)


def _line(x1: float, y1: float, x2: float, y2: float, kind: str = "grid") -> Markup:
    places: Mapping[str, float] = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
    return element("line", class_=kind, **{key: f"{at:.1f}" for key, at in places.items()})


def _row_name(text: str, row: int) -> Markup:
    y = TOP + STRIP_HEIGHT * row + 0.5 * STRIP_HEIGHT + 3.0
    return element("text", text, x=f"{LEFT - 6:.1f}", y=f"{y:.1f}", class_="y")
