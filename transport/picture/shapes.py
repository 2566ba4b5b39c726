"""Shapes of the picture: cars, roads, name tags, and their frames."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rerun as rr

from transport.columns import Array
from transport.panels import PANELS, Colour
from transport.picture.blueprint import LANE_EDGE, LEGEND_WIDTH, MARKS, ROAD, WORST
from vehicles.geometry.lanes import lane_edges as edges_of

MARK_SPACING_M = 50.0
MARK_CLEARANCE_M = 15.0  # Least distance between two marks: later laps have none
CHARACTER, ROW_HEIGHT = 0.95, 3.7  # Width and height (in the legend's unit)


class CarShape(NamedTuple):
    """Length and width (m) of a car, and the distance of its middle ahead of its pose."""

    length: float
    width: float
    forward: float


def plan_frame() -> rr.Transform3D:
    """Frame of the plans, with north up."""
    places, matrices = axes_of(np.array([[0.0, 0.0, 0.0, True, 1.0]]))
    return rr.Transform3D(translation=places[0], mat3x3=matrices[0].T)


def axes_of(frames: Array) -> tuple[Array, Array]:
    """Origins (N, 3) and axes (N, 3, 3) of frames with rows of east, north, yaw, flip and unit (m).

    `axes[n, k]` is axis k of frame n in the world. With `flip` the second axis points to the right
    instead of the left: a picture's second axis points down, so that left turns turn left.
    """
    east, north, yaw, flip, unit = frames.T
    c, s, left = unit * np.cos(yaw), unit * np.sin(yaw), 1.0 - 2.0 * flip
    zero = np.zeros(len(frames))
    axes = [[c, s, zero], [-s * left, c * left, zero], [zero, zero, unit]]
    return np.column_stack((east, north, zero)), np.moveaxis(np.array(axes), 2, 0)


def line_style(colour: Colour, *, width: float, order: float) -> rr.LineStrips2D:
    """Style of a line that is logged in pieces; it is logged once to make each piece cheaper."""
    return rr.LineStrips2D.from_fields(
        colors=[colour], radii=rr.Radius.ui_points(width), draw_order=order
    )


def point_style(*, width: float, order: float) -> rr.Points2D:
    return rr.Points2D.from_fields(radii=rr.Radius.ui_points(width), draw_order=order)


def car(shape: CarShape, colour: Colour) -> rr.LineStrips2D:
    """Draw a car seen from above, front towards its first axis, with the outline of `shape`.

    Thick lines side by side fill it; Boxes2D would draw an outline only.
    """
    length, width, forward = shape
    lines = 8
    radius = 0.6 * width / lines  # so that they overlap
    reach, half_width = 0.5 * length - radius, 0.5 * width - radius
    sides = [half_width * (2 * line / (lines - 1) - 1) for line in range(lines)]
    body = [[[forward - reach, side], [forward + reach, side]] for side in sides]
    screen = forward + 0.16 * length
    windscreen = [[[screen, sides[1]], [screen, sides[-2]]]]
    return rr.LineStrips2D(
        body + windscreen,
        colors=[colour] * lines + [(0, 0, 0)],
        radii=[radius] * lines + [0.07 * length],
        draw_order=20,
    )


def name_tag(text: str, colour: Colour, left_m: float) -> rr.Points2D:
    return rr.Points2D([[0.0, left_m]], colors=[colour], radii=0.0, labels=[text], draw_order=30)


def ring(*, shown: bool) -> rr.Points2D:
    """Ring a car, in the car's frame; the car covers the middle."""
    places = [[0.0, 0.0]] if shown else []
    return rr.Points2D(places, colors=[WORST], radii=rr.Radius.ui_points(18.0), draw_order=15)


def ring_label(label: str, right_m: float) -> rr.Points2D:
    """Write a label `right_m` to the right of a ringed car; an empty label removes it."""
    return rr.Points2D(
        [[0.0, -right_m]] if label else [],
        colors=[WORST],
        radii=0.0,
        labels=[label] if label else [],
        show_labels=True,
        draw_order=42,
    )


def lane_edges(east: Sequence[float], north: Sequence[float], width: float) -> rr.LineStrips2D:
    """Draw both edges of a lane of `width` (m) along a path (m)."""
    return rr.LineStrips2D(
        edges_of(np.column_stack([east, north]), width),
        colors=[LANE_EDGE],
        radii=rr.Radius.ui_points(0.7),
        draw_order=0,
    )


def legend(items: Sequence[tuple[str, Colour]]) -> rr.Points2D:
    places, x, y = [], 0.0, 0.8
    for label, _ in items:
        width = 3.2 + CHARACTER * len(label)
        if x + width > LEGEND_WIDTH:
            x, y = 0.0, y + ROW_HEIGHT
        places.append([x + 0.5 * width, y])
        x += width
    return rr.Points2D(
        places,
        colors=[colour for _, colour in items],
        radii=rr.Radius.ui_points(5.0),
        labels=[label for label, _ in items],
        show_labels=True,
    )


def road_with_marks(
    east: Sequence[float], north: Sequence[float], right_m: float
) -> tuple[rr.LineStrips2D, rr.Points2D]:
    """Draw a path (m), and `right_m` to its right the distance along it every 50 m."""
    points = np.column_stack([east, north])
    steps = np.diff(points, axis=0)
    station = np.concatenate([[0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))])
    at = np.arange(0.0, station[-1], MARK_SPACING_M)
    piece = np.clip(np.searchsorted(station, at, side="right") - 1, 0, len(steps) - 1)
    along = steps[piece] / np.hypot(steps[piece, 0], steps[piece, 1])[:, None]
    on_path = points[piece] + along * (at - station[piece])[:, None]
    to_the_right = np.column_stack([along[:, 1], -along[:, 0]])
    places = on_path + right_m * to_the_right
    kept: list[int] = []
    for mark, place in enumerate(places):
        if not kept or np.hypot(*(places[kept] - place).T).min() >= MARK_CLEARANCE_M:
            kept.append(mark)
    road = rr.LineStrips2D([points], colors=[ROAD], radii=rr.Radius.ui_points(1.0), draw_order=1)
    marks = rr.Points2D(
        places[kept],
        colors=[ROAD],
        radii=rr.Radius.ui_points(2.0),
        labels=[f"{distance:.0f} m" for distance in at[kept]],
        show_labels=True,
        draw_order=2,
    )
    return road, marks


# ---- Marks of events and changes, by place in the plans and by time in the plots


ROW_RATIO = 0.75  # Distance between rows of names, in distances of name tags


@dataclass(frozen=True, slots=True)
class Mark:
    """An event or change at instant `at_ns` and place (east, north) in metres."""

    kind: str
    at_ns: int
    place: tuple[float, float]
    vehicles: tuple[str, ...]
    text: str = ""

    @property
    def label(self) -> str:
        title = self.text or self.kind.replace("_", " ")
        return f"{title} {' '.join(reversed(self.vehicles))}"

    @property
    def plots(self) -> tuple[str, ...]:
        return _marked_plots(self.vehicles[-1:])


def _marked_plots(vehicles: Sequence[str]) -> tuple[str, ...]:
    """Names of the marked plots of all vehicles, and of those of each of `vehicles`."""
    marked = [panel for panel in PANELS.values() if panel.marked]
    common = [panel.name for panel in marked if panel.kind == "plot"]
    own = [panel.name for panel in marked if panel.kind == "plot_of_one"]
    return (*common, *(f"{panel}/{name}" for panel in own for name in vehicles))


class Marks:
    """Draws marks with the colour and shape of their kind."""

    def __init__(self, recording: rr.RecordingStream, followers: Sequence[str]) -> None:
        self._recording = recording
        plots = _marked_plots(followers)
        for kind, (colour, shape, size) in MARKS.items():
            style = rr.SeriesPoints(
                colors=[colour],
                markers=[shape],
                names=[kind.replace("_", " ")],
                marker_sizes=[size],
            )
            for plot in plots:
                recording.log(f"plots/{plot}/events/{kind}", style, static=True)

    def draw(self, mark: Mark, yaw: float, tag_m: float) -> None:
        """Draw a mark at the recording's present time, on a road in direction `yaw` (rad).

        Names are to the right of the road in a row for each kind, the first at `tag_m`.
        """
        colour, _, _ = MARKS[mark.kind]
        spot = rr.Points2D(
            [mark.place], colors=[colour], radii=rr.Radius.ui_points(6.0), draw_order=40
        )
        right_m = tag_m * (1.0 + ROW_RATIO * list(MARKS).index(mark.kind))
        (east, north), right = mark.place, (math.sin(yaw), -math.cos(yaw))
        name = rr.Points2D(
            [[east + right_m * right[0], north + right_m * right[1]]],
            colors=[colour],
            radii=0.0,
            labels=[mark.label],
            show_labels=True,
            draw_order=41,
        )
        self._recording.log(f"world/events/{mark.kind}", spot)
        self._recording.log(f"world/events/{mark.kind}/name", name)
        for plot in mark.plots:  # on the zero line
            self._recording.log(f"plots/{plot}/events/{mark.kind}", rr.Scalars(0.0))
