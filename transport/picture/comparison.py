"""Draws several runs into one recording: each value has a time and a distance along the path."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rerun as rr

from transport.panels import PANELS, Colour, colour_of
from transport.picture.batch import Floats, Road
from transport.picture.layout import WORST, Reach, comparison_blueprint
from transport.picture.rows import TIMELINE, frames_of
from transport.picture.shapes import (
    CarShape,
    car,
    dot,
    draw_road,
    label_style,
    legend,
    line_style,
    name_tag,
    plan_frame,
    point_style,
)

PLACE_TIMELINE = "path_m"  # Whole metres along the path of the first run
FADED = 0.45  # Brightness of the first run, of which the others differ
CAR_STEP = 2  # True poses (50 Hz) per position of a car


class PlottedCurve(NamedTuple):
    """Values over time (s after the start) and over the distance along the path (m), (N) each."""

    at_s: Floats
    station_m: Floats
    values: Floats


class ModeStart(NamedTuple):
    """A mode of a vehicle, from a time (s) and a distance along the path (m) on."""

    at_s: float
    station_m: float
    mode: str


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleTrack:
    """One vehicle of the run `run` (A, B, …), at `place` in its convoy.

    `body` is its length and width (m), and the distance of its middle ahead of its pose. Positions
    (N) are in the common plane (m), `yaw_rad` is counter-clockwise from east. `curves` are by
    quantity: error, gap, and from the second run on the difference from the first one.
    """

    run: str
    vehicle: str
    place: int
    body: tuple[float, float, float]
    at_s: Floats
    station_m: Floats
    east_m: Floats
    north_m: Floats
    yaw_rad: Floats
    curves: dict[str, PlottedCurve]
    modes: Sequence[ModeStart]


@dataclass(frozen=True, slots=True, kw_only=True)
class DivergencePoint:
    """The first place at which two runs differ."""

    at_s: float
    station_m: float
    east_m: float
    north_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedTracks:
    """All that the picture of several runs shows.

    `path` is east and north of the common path (m), `lane_m` the width of its lane, `spacing_m` the
    usual spacing of two vehicles, and `text` a description in Markdown.
    """

    vehicles: Sequence[str]
    tracks: Sequence[VehicleTrack]
    path: Road
    lane_m: float
    spacing_m: float
    divergence: DivergencePoint | None
    text: str

    @property
    def runs(self) -> list[str]:
        return list(dict.fromkeys(track.run for track in self.tracks))


def draw_tracks(recording: rr.RecordingStream, compared: ComparedTracks) -> None:
    """Draw all tracks into a recording and send its layout."""
    vehicles, runs, path = compared.vehicles, compared.runs, compared.path
    layout = comparison_blueprint(vehicles, spacing_m=compared.spacing_m, road=path, runs=len(runs))
    recording.send_blueprint(layout)
    tag_m = Reach.of(len(vehicles), compared.spacing_m, path).tag_m
    draw_road(recording, path, compared.lane_m)
    recording.log("world/plan", plan_frame(), static=True)
    followed = vehicles[len(vehicles) // 2]
    items: list[tuple[str, Colour]] = []
    for track in sorted(compared.tracks, key=lambda one: (one.place, one.run)):
        number = runs.index(track.run)
        colour = _colour(track.place, number)
        _draw_car(recording, track, colour, tag_m if number else -tag_m)
        _draw_curves(recording, track, colour, 1.5 if number else 2.5)
        _draw_modes(recording, track)
        if track.vehicle == followed and not number:
            _draw_positions(recording, ["world/convoy"], track, flip=True)
        items.append((f"{track.vehicle} {track.run}", colour))
    if compared.divergence is not None:
        _draw_divergence(recording, compared.divergence, tag_m)
        items.append(("first divergence", WORST))
    recording.log("legend", legend(items), static=True)
    text = rr.TextDocument(compared.text, media_type=rr.MediaType.MARKDOWN)
    recording.log("text", text, static=True)


def _colour(place: int, number: int) -> Colour:
    """The vehicle's colour, mixed with grey for the first run and lightened from the third on."""
    share = (FADED, 1.0, 0.75, 0.6)[min(number, 3)]
    grey = 0x80 if number == 0 else 0xFF
    red, green, blue = (round(share * part + (1.0 - share) * grey) for part in colour_of(place))
    return red, green, blue


def _times(at_s: Floats, station_m: Floats) -> list[rr.TimeColumn]:
    since_start = np.round(at_s * 1e9).astype("timedelta64[ns]")
    furthest = np.maximum.accumulate(station_m)  # a car that rolls back stays where it was
    return [
        rr.TimeColumn(TIMELINE, duration=since_start),
        rr.TimeColumn(PLACE_TIMELINE, sequence=np.round(furthest).astype(np.int64)),
    ]


def _draw_car(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, tag_m: float
) -> None:
    name = f"{track.run}/{track.vehicle}"
    points = np.column_stack((track.east_m, track.north_m))[::CAR_STEP]
    driven = rr.LineStrips2D.from_fields(strips=[points])
    recording.log(f"world/driven/{name}", driven, static=True)
    style = line_style(colour, width=1.0, order=5)
    recording.log(f"world/driven/{name}", style, static=True)
    recording.log(f"world/cars/{name}", car(CarShape(*track.body), colour), static=True)
    recording.log(f"world/cars/{name}/dot", dot(colour, width=4.0, order=19), static=True)
    tag = name_tag(f"{track.vehicle} {track.run}", colour, tag_m)
    recording.log(f"world/names/{name}", tag, static=True)
    _draw_positions(recording, [f"world/cars/{name}", f"world/names/{name}"], track)


def _draw_positions(
    recording: rr.RecordingStream, entities: Sequence[str], track: VehicleTrack, flip: bool = False
) -> None:
    """Move frames with a vehicle."""
    rows = np.flatnonzero(np.isfinite(track.station_m))[::CAR_STEP]
    if not rows.size:
        return
    poses = np.column_stack((track.east_m, track.north_m, track.yaw_rad))[rows]
    times = _times(track.at_s[rows], track.station_m[rows])
    for entity in entities:
        recording.send_columns(entity, times, frames_of(poses, flip=flip))


def _draw_curves(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, width: float
) -> None:
    style = rr.SeriesLines(colors=[colour], names=[f"{track.vehicle} {track.run}"], widths=[width])
    for quantity, curve in track.curves.items():
        known = np.isfinite(curve.values) & np.isfinite(curve.station_m)
        if known.any():
            entity = f"plots/{quantity}/{track.vehicle}/{track.run}"
            recording.log(entity, style, static=True)
            times = _times(curve.at_s[known], curve.station_m[known])
            recording.send_columns(entity, times, rr.Scalars.columns(scalars=curve.values[known]))


def _draw_modes(recording: rr.RecordingStream, track: VehicleTrack) -> None:
    modes = [one for one in track.modes if np.isfinite(one.station_m)]
    if not modes or not track.place:
        return
    entity = f"mode/{track.vehicle}_{track.run}"
    states = PANELS["mode"].states
    names, colours = list(states), list(states.values())
    style = rr.StateConfiguration(values=names, labels=names, colors=colours)
    recording.log(entity, style, static=True)
    at_s, station_m, words = zip(*modes, strict=True)
    times = _times(np.array(at_s), np.array(station_m))
    recording.send_columns(entity, times, rr.StateChange.columns(state=words))


def _draw_divergence(recording: rr.RecordingStream, first: DivergencePoint, tag_m: float) -> None:
    """Mark the first divergence in the plans and, on the zero line, in the plots of errors."""
    marks = {
        "world/divergence": (
            point_style(width=7.0, order=40, colour=WORST),
            [first.east_m, first.north_m],
        ),
        "world/divergence/name": (
            label_style(WORST, order=41, text=f"first divergence, {first.station_m:.0f} m"),
            [first.east_m, first.north_m + tag_m],
        ),
    }
    for entity, (mark, place) in marks.items():
        recording.log(entity, mark, static=True)
        recording.log(entity, rr.Points2D.from_fields(positions=[place]), static=True)
    style = rr.SeriesPoints(
        colors=[WORST], markers=["Diamond"], names=["first divergence"], marker_sizes=[7.0]
    )
    times = _times(np.array([first.at_s]), np.array([first.station_m]))
    for quantity in ("error", "difference"):
        entity = f"plots/{quantity}/divergence"
        recording.log(entity, style, static=True)
        recording.send_columns(entity, times, rr.Scalars.columns(scalars=[0.0]))
