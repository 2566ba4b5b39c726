"""Draws several runs into one recording: each value has a time and a distance along the path."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from transport.panels import PANELS, Colour, colour_of
from transport.picture.batch import Floats, RunScene
from transport.picture.layout import WORST, Reach, comparison_blueprint
from transport.picture.rows import TIMELINE, frames_of
from transport.picture.shapes import (
    CarShape,
    car,
    draw_road,
    legend,
    line_style,
    plan_frame,
    points,
)

PLACE_TIMELINE = "path_m"  # Whole metres along the path of the first run
FADED = 0.45  # Brightness of the first run, of which the others differ
CAR_STEP = 2  # True poses (50 Hz) per position of a car


class Placed(NamedTuple):
    """Values (N) at times (s after the start) and distances along the path (m)."""

    at_s: Floats
    station_m: Floats
    values: Any

    def times(self) -> list[rr.TimeColumn]:
        since_start = np.round(self.at_s * 1e9).astype("timedelta64[ns]")
        furthest = np.maximum.accumulate(self.station_m)  # a car that rolls back stays there
        return [
            rr.TimeColumn(TIMELINE, duration=since_start),
            rr.TimeColumn(PLACE_TIMELINE, sequence=np.round(furthest).astype(np.int64)),
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleTrack:
    """One vehicle of the run `run` (A, B, …), at `place` in its convoy.

    `body` is its length and width (m), and the distance of its middle ahead of its pose. `poses`
    have rows of east and north in the common plane (m) and yaw (rad). `curves` are by quantity:
    error, gap, and from the second run on the difference from the first one. `modes` begin there.
    """

    run: str
    vehicle: str
    place: int
    body: tuple[float, float, float]
    poses: Placed
    curves: Mapping[str, Placed]
    modes: Placed

    @property
    def label(self) -> str:
        return f"{self.vehicle} {self.run}"


def draw_tracks(
    recording: rr.RecordingStream,
    scene: RunScene,
    tracks: Sequence[VehicleTrack],
    divergence: Placed | None,
    text: str,
) -> None:
    """Draw the tracks of several runs into a recording and send its layout.

    `divergence` is the place (east, north) at which two runs first differ, `text` Markdown.
    """
    runs = list(dict.fromkeys(track.run for track in tracks))
    recording.send_blueprint(comparison_blueprint(scene, len(runs)))
    tag_m = Reach.of(scene).tag_m
    draw_road(recording, scene)
    recording.log("world/plan", plan_frame(), static=True)
    followed = scene.vehicles[len(scene.vehicles) // 2]
    items: list[tuple[str, Colour]] = []
    for track in sorted(tracks, key=lambda one: (one.place, one.run)):
        number = runs.index(track.run)
        colour = _colour(track.place, number)
        _draw_car(recording, track, colour, tag_m if number else -tag_m)
        _draw_curves(recording, track, colour, 1.5 if number else 2.5)
        _draw_modes(recording, track)
        if track.vehicle == followed and not number:
            _draw_positions(recording, ["world/convoy"], track, flip=True)
        items.append((track.label, colour))
    if divergence is not None:
        _draw_divergence(recording, divergence)
        items.append(("first divergence", WORST))
    recording.log("legend", legend(items), static=True)
    document = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
    recording.log("text", document, static=True)


def _colour(place: int, number: int) -> Colour:
    """The vehicle's colour, mixed with grey for the first run and lightened from the third on."""
    share = (FADED, 1.0, 0.75, 0.6)[min(number, 3)]
    grey = 0x80 if number == 0 else 0xFF
    red, green, blue = (round(share * part + (1.0 - share) * grey) for part in colour_of(place))
    return red, green, blue


def _draw_car(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, tag_m: float
) -> None:
    name = f"{track.run}/{track.vehicle}"
    shapes = {
        f"driven/{name}": rr.LineStrips2D.from_fields(strips=[track.poses.values[::CAR_STEP, :2]]),
        f"cars/{name}": car(CarShape(*track.body), colour),
        f"cars/{name}/dot": points(width=4.0, order=19, colour=colour, at=(0.0, 0.0)),
        f"names/{name}": points(order=30, colour=colour, text=track.label, at=(0.0, tag_m)),
    }
    style = line_style(colour, width=1.0, order=5)
    recording.log(f"world/driven/{name}", style, static=True)
    for entity, shape in shapes.items():
        recording.log(f"world/{entity}", shape, static=True)
    _draw_positions(recording, [f"world/cars/{name}", f"world/names/{name}"], track)


def _draw_positions(
    recording: rr.RecordingStream, entities: Sequence[str], track: VehicleTrack, flip: bool = False
) -> None:
    """Move frames with a vehicle."""
    rows = np.flatnonzero(np.isfinite(track.poses.station_m))[::CAR_STEP]
    placed = Placed(*(column[rows] for column in track.poses))
    for entity in entities if rows.size else ():
        frames = frames_of(placed.values, flip=flip)
        recording.send_columns(entity, placed.times(), frames)


def _draw_curves(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, width: float
) -> None:
    style = rr.SeriesLines(colors=[colour], names=[track.label], widths=[width])
    for quantity, curve in track.curves.items():
        known = np.isfinite(curve.values) & np.isfinite(curve.station_m)
        if known.any():
            entity = f"plots/{quantity}/{track.vehicle}/{track.run}"
            drawn = Placed(*(column[known] for column in curve))
            recording.log(entity, style, static=True)
            scalars = rr.Scalars.columns(scalars=drawn.values)
            recording.send_columns(entity, drawn.times(), scalars)


def _draw_modes(recording: rr.RecordingStream, track: VehicleTrack) -> None:
    known = np.isfinite(track.modes.station_m)
    if track.place and known.any():
        modes = Placed(*(column[known] for column in track.modes))
        entity, states = f"mode/{track.vehicle}_{track.run}", PANELS["mode"].states
        names, colours = list(states), list(states.values())
        style = rr.StateConfiguration(values=names, labels=names, colors=colours)
        recording.log(entity, style, static=True)
        changes = rr.StateChange.columns(state=modes.values.tolist())
        recording.send_columns(entity, modes.times(), changes)


def _draw_divergence(recording: rr.RecordingStream, first: Placed) -> None:
    """Mark the first divergence in the plans and, on the zero line, in the plots of errors."""
    text = f"first divergence, {first.station_m[0]:.0f} m"
    (east, north), *_ = first.values.tolist()
    mark = points(width=7.0, order=40, colour=WORST, text=text, at=(east, north))
    recording.log("world/divergence", mark, static=True)
    point = rr.SeriesPoints(
        colors=[WORST], markers=["Diamond"], names=["first divergence"], marker_sizes=[7.0]
    )
    for quantity in ("error", "difference"):
        entity = f"plots/{quantity}/divergence"
        recording.log(entity, point, static=True)
        recording.send_columns(entity, first.times(), rr.Scalars.columns(scalars=[0.0]))
