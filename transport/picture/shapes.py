"""Shapes of the picture: cars, roads, name tags and the legend."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from transport.panels import ROAD, Colour
from transport.picture.batch import RunScene
from transport.picture.layout import LEGEND_WIDTH
from transport.picture.rows import axes_of
from vehicles.geometry.lanes import lane_edges as edges_of

MARK_SPACING_M = 50.0
MARK_CLEARANCE_M = 15.0  # Least distance between two marks: later laps have none
LANE_EDGE = (0x58, 0x58, 0x58)
CHARACTER, ROW_HEIGHT = 0.95, 3.7  # Width and height (in the legend's unit)


class CarShape(NamedTuple):
    """Length and width (m) of a car, and the distance of its middle ahead of its pose."""

    length: float
    width: float
    forward: float


def line_style(colour: Colour, *, width: float, order: float) -> rr.LineStrips2D:
    """Style of a line that is logged in pieces; it is logged once to make each piece cheaper."""
    return rr.LineStrips2D.from_fields(
        colors=[colour], radii=rr.Radius.ui_points(width), draw_order=order
    )


def points(
    *,
    order: float,
    width: float = 0.0,
    colour: Colour | None = None,
    text: str | None = None,
    at: tuple[float, float] | None = None,
) -> rr.Points2D:
    """A point at `at` (m), `width` wide on the screen, with a text.

    What is not given is sent later; a point without width is a text only.
    """
    return rr.Points2D.from_fields(
        positions=None if at is None else [at],
        colors=None if colour is None else [colour],
        labels=None if text is None else [text],
        radii=rr.Radius.ui_points(width),
        show_labels=True,
        draw_order=order,
    )


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


def draw_road(recording: rr.RecordingStream, scene: RunScene) -> None:
    """Draw the path of the lead and the edges of its lane, with north up."""
    frame = rr.Transform3D(mat3x3=axes_of(np.zeros((1, 3)), 1.0, flip=True)[0].T)
    recording.log("world/plan", frame, static=True)
    points = np.column_stack(scene.path)
    radius = rr.Radius.ui_points
    road = rr.LineStrips2D([points], colors=[ROAD], radii=radius(1.0), draw_order=1)
    recording.log("world/road/path", road, static=True)
    edges = edges_of(points, scene.lane_m)
    lane = rr.LineStrips2D(edges, colors=[LANE_EDGE], radii=radius(0.7), draw_order=0)
    recording.log("world/road/lane", lane, static=True)


def road_marks(east: Sequence[float], north: Sequence[float], right_m: float) -> rr.Points2D:
    """Mark the distance along a path (m) every 50 m, `right_m` to its right."""
    station = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east), np.diff(north)))])
    at = np.arange(0.0, station[-1], MARK_SPACING_M)
    on_path, ahead = (
        np.column_stack([np.interp(along, station, axis) for axis in (east, north)])
        for along in (at, at + 0.1)
    )
    direction = (ahead - on_path) / np.hypot(*(ahead - on_path).T)[:, None]
    places = on_path + right_m * np.column_stack([direction[:, 1], -direction[:, 0]])
    kept: list[int] = []
    for mark, place in enumerate(places):
        if not kept or np.hypot(*(places[kept] - place).T).min() >= MARK_CLEARANCE_M:
            kept.append(mark)
    return rr.Points2D(
        places[kept],
        colors=[ROAD],
        radii=rr.Radius.ui_points(2.0),
        labels=[f"{distance:.0f} m" for distance in at[kept]],
        show_labels=True,
        draw_order=2,
    )
