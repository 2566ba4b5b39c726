"""Pictures of a run as inline SVG: plan, curves over time, strips of modes and losses.

The script of the page reads the curves back from their paths: `data-` attributes hold the scales.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.results.recorded.modes import mode_changes
from scenarios.results.recorded.run_record import RunRecord
from scenarios.results.report.axes import Scale, thinned, value_range
from scenarios.results.report.markup import Markup, element, join
from transport.colours import Colour, colour_of
from transport.panels import PANELS

Floats = NDArray[np.float64]
WIDTH, LEFT, RIGHT = 900.0, 58.0, 8.0
TOP, BOTTOM = 8.0, 24.0
PLOT_HEIGHT, PLAN_HEIGHT = 170.0, (120.0, 420.0)
STRIP_HEIGHT = 16.0
ALL_POINTS, LEAST_POINTS, MOST_POINTS = 16_000, 80, 700
"""Points of all curves together, and of one; they limit the size of the file."""
PLAN_POINTS = 200
MOST_STRIPS = 24
"""Links with a strip, those that lost most."""
LOSS_CELLS, LEAST_CELL_S = 150, 0.5
"""Parts of the run whose loss is shown, and their least duration."""


Span = tuple[float, float]
"""Begin and end of a time (s)."""


class TimeMark(NamedTuple):
    """A text about a time (s); `kind` is event or note."""

    at_s: float
    text: str
    kind: str


@dataclass(frozen=True, slots=True)
class CurveOfVehicle:
    """Values of one vehicle over time (s)."""

    name: str
    place: int
    at_s: Floats
    values: Floats


def colour_code(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


class RunPlots:
    """The pictures of one run, with one time axis."""

    def __init__(self, record: RunRecord, ran_s: float, marks: Sequence[TimeMark] = ()) -> None:
        """`marks` are drawn above the curves."""
        self._record = record
        self._marks = marks
        self._ran_s = max(ran_s, 0.1)
        self._time = Scale(0.0, self._ran_s, LEFT, WIDTH - RIGHT)
        self._names = [
            name
            for name in record.vehicle_names
            if name in record.columns_of("truth") and len(record.columns_of("truth")[name])
        ]
        count = max(3 * len(self._names), 1)
        self._points = min(max(ALL_POINTS // count, LEAST_POINTS), MOST_POINTS)

    @property
    def is_empty(self) -> bool:
        return not self._names

    def figures(self) -> Iterator[Markup]:
        """Yield all pictures with their titles."""
        yield _figure("Plan", "north up", self._plan())
        for title, unit, name in (
            ("True error from the lead's path", "m, left positive", "error_m"),
            ("True gap to the vehicle ahead", "m, bumper to bumper", "gap_m"),
            ("Speed", "m/s", "speed_mps"),
        ):
            curves = [curve for curve in self._curves(name) if np.isfinite(curve.values).any()]
            if curves:
                yield _figure(title, unit, self._plot(name, curves))
        yield _figure("Modes", "of each vehicle, defined below", self._modes())
        if losses := self._losses():
            yield _figure("Messages lost", "of each link, stronger for a larger share", losses)

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

    def _curves(self, name: str) -> list[CurveOfVehicle]:
        curves = []
        for place, vehicle in enumerate(self._names):
            true = self._record.vehicles[vehicle].true
            curves.append(CurveOfVehicle(vehicle, place, true.t_s, true[name]))
        return curves

    # ---- Curves

    def _plot(self, name: str, curves: Sequence[CurveOfVehicle]) -> Markup:
        height = PLOT_HEIGHT
        low, high = value_range([curve.values for curve in curves])
        scale = Scale(low, high, height - BOTTOM, TOP)
        paths = []
        for curve in curves:
            at_s, values = thinned(curve.at_s, curve.values, self._points)
            d = path_data(self._time.to_pixels(at_s), scale.to_pixels(values))
            paths.append(
                element(
                    "path",
                    class_="curve",
                    d=d,
                    stroke=self._colour(curve.name),
                    data_name=curve.name,
                )
            )
        return self._svg(
            height,
            *self._grid(height, scale),
            *paths,
            *self._drawn_marks(),
            kind="plot",
            data_quantity=name,
            data_low=f"{low:.9g}",
            data_high=f"{high:.9g}",
        )

    def _drawn_marks(self) -> Iterator[Markup]:
        for mark in self._marks:
            x = self._time.pixel(min(max(mark.at_s, 0.0), self._ran_s))
            title = element("title", f"{mark.at_s:.2f} s: {mark.text}")
            d = f"M{x:.1f} {TOP + 8:g}l-4.5 -8h9z"
            yield element("path", title, d=d, class_=f"mark {mark.kind}")

    def _grid(self, height: float, scale: Scale | None = None) -> Iterator[Markup]:
        bottom = height - BOTTOM
        for value in self._time.ticks(8):
            x = self._time.pixel(value)
            yield _line(x, TOP, x, bottom)
            yield element("text", f"{value:g}", x=f"{x:.1f}", y=f"{height - 8:.1f}", class_="x")
        for value in scale.ticks(4) if scale else ():
            y = scale.pixel(value) if scale else 0.0
            yield _line(LEFT, y, WIDTH - RIGHT, y, "zero" if abs(value) < 1e-12 else "grid")
            text = f"{value + 0.0:.6g}"
            yield element("text", text, x=f"{LEFT - 6:.1f}", y=f"{y + 4:.1f}", class_="y")

    def _svg(self, height: float, *content: Markup, kind: str, **data: object) -> Markup:
        cursor = element("line", class_="cursor", x1=0, x2=0, y1=TOP, y2=f"{height - BOTTOM:.1f}")
        return element(
            "svg",
            *content,
            cursor,
            viewBox=f"0 0 {WIDTH:g} {height:g}",
            class_=kind,
            role="img",
            data_seconds=f"{self._ran_s:.9g}",
            **data,
        )

    # ---- Strips

    def _modes(self) -> Markup:
        states = PANELS["mode"].states
        height = TOP + STRIP_HEIGHT * len(self._names) + BOTTOM
        content = list(self._grid(height))
        used: dict[str, None] = {}
        for row, name in enumerate(self._names):
            changes = mode_changes(self._record.vehicles[name])
            edges = [change.at_s for change in changes] + [self._ran_s]
            content.append(_row_name(name, row))
            spans: dict[str, list[Span]] = {}
            for (begin, end), change in zip(pairwise(edges), changes, strict=False):
                spans.setdefault(change.mode, []).append((begin, end))
            for mode, times in spans.items():
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
        return join(self._svg(height, *content, kind="strips"), key)

    def _cells(self, row: int, spans: Sequence[Span], title: str, **style: object) -> Markup:
        """Draw the times (s) of a row with one style as one path."""
        top, height = TOP + STRIP_HEIGHT * row, STRIP_HEIGHT - 2.0
        parts = []
        for begin, end in spans:
            first, last = self._time.pixel(max(begin, 0.0)), self._time.pixel(min(end, self._ran_s))
            width = max(last - first, 0.4)
            parts.append(f"M{first:.1f} {top:g}h{width:.1f}v{height:g}h-{width:.1f}z")
        return element("path", element("title", title), d="".join(parts), **style)

    def _losses(self) -> Markup | None:
        """Strips of the share of messages lost; None if all links delivered everything."""
        cell_s = max(self._ran_s / LOSS_CELLS, LEAST_CELL_S)
        shares = {link: self._shares(link, cell_s) for link in self._record.links}
        worst = sorted(shares, key=lambda link: -float(np.nansum(shares[link])))[:MOST_STRIPS]
        shown = [link for link in shares if link in worst]
        if not any(float(np.nansum(shares[link])) > 0.0 for link in shown):
            return None
        height = TOP + STRIP_HEIGHT * len(shown) + BOTTOM
        content = list(self._grid(height))
        for row, (sender, receiver) in enumerate(shown):
            content.append(_row_name(f"{sender} → {receiver}", row))
            values = shares[sender, receiver]
            edges = np.flatnonzero(np.diff(values, prepend=-1.0, append=-1.0) != 0.0).tolist()
            spans: dict[float, list[Span]] = {}
            for first, last in pairwise(edges):
                spans.setdefault(float(values[first]), []).append((first * cell_s, last * cell_s))
            for share, times in spans.items():
                if share > 0.0:
                    title = f"{sender} → {receiver}: {share:.0%} lost"
                    opacity = f"{share:.1f}"
                    content.append(self._cells(row, times, title, class_="loss", opacity=opacity))
        return self._svg(height, *content, kind="strips")

    def _shares(self, link: tuple[str, str], cell_s: float) -> Floats:
        """Share lost of the messages sent in each part of the run, to a tenth; 0 without any."""
        outcomes = self._record.links[link].outcomes
        cells = (outcomes.t_s / cell_s).astype(int)
        count = int(np.ceil(self._ran_s / cell_s)) + 1
        inside = (cells >= 0) & (cells < count)
        sent = np.bincount(cells[inside], minlength=count)
        lost = np.isin(outcomes.outcome, ("dropped", "not_arrived")) & inside
        missing = np.bincount(cells[lost], minlength=count)
        shares: Floats = np.ceil(10.0 * missing / np.maximum(sent, 1)) / 10.0
        return shares

    # ---- Plan

    def _plan(self) -> Markup:
        times = np.linspace(0.0, self._ran_s, PLAN_POINTS)
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
            data_seconds=f"{self._ran_s:.9g}",
        )

    def _track(self, name: str, times: Floats) -> tuple[Floats, Floats]:
        """East and north (m) at times (s); before the first and after the last pose as there."""
        true = self._record.vehicles[name].true
        return np.interp(times, true.t_s, true.east_m), np.interp(times, true.t_s, true.north_m)


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
