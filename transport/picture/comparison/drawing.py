"""Draws several runs into one recording: each value has a time and a distance along the path."""

from typing import Any

import numpy as np
import rerun as rr

from transport.colours import Colour, colour_of
from transport.panels import PANELS
from transport.picture.blueprint import TIMELINE, WORST, Reach
from transport.picture.comparison.layout import PLACE_TIMELINE, comparison_blueprint
from transport.picture.comparison.tracks import ComparedTracks, Floats, VehicleTrack
from transport.picture.shapes import CarShape, car, lane_edges, legend, plan_frame, road_with_marks

FADED = 0.45  # Brightness of the first run, of which the others differ
CAR_STEP = 2  # True poses (50 Hz) per position of a car


def draw_tracks(recording: rr.RecordingStream, compared: ComparedTracks) -> None:
    """Draw all tracks into a recording and send its layout."""
    vehicles, runs = compared.vehicles, list(dict.fromkeys(one.run for one in compared.tracks))
    spacing_m = compared.spacing_m
    recording.send_blueprint(
        comparison_blueprint(vehicles, spacing_m=spacing_m, road=compared.path, runs=len(runs))
    )
    reach = Reach.of(len(vehicles), spacing_m, compared.path)
    _draw_road(recording, compared, reach.tag_m)
    middle = vehicles[len(vehicles) // 2]
    for track in compared.tracks:
        number = runs.index(track.run)
        colour = _colour(track, number)
        _draw_car(recording, track, colour, reach.tag_m * (1.0 if number else -1.0))
        _draw_curves(recording, track, colour, number)
        _draw_modes(recording, track)
        if track.vehicle == middle and not number:
            _draw_eye(recording, track)
    _draw_divergence(recording, compared, reach.tag_m)
    text = rr.TextDocument(compared.text, media_type=rr.MediaType.MARKDOWN)
    recording.log("text", text, static=True)
    items = [
        (f"{track.vehicle} {track.run}", _colour(track, runs.index(track.run)))
        for track in sorted(compared.tracks, key=lambda one: (one.place, one.run))
    ]
    if compared.divergence is not None:
        items.append(("first divergence", WORST))
    recording.log("legend", legend(items), static=True)


def _colour(track: VehicleTrack, number: int) -> Colour:
    """The vehicle's colour, mixed with grey for the first run and lightened from the third on."""
    share = (FADED, 1.0, 0.75, 0.6)[min(number, 3)]
    grey = 0x80 if number == 0 else 0xFF
    red, green, blue = (
        round(share * part + (1.0 - share) * grey) for part in colour_of(track.place)
    )
    return red, green, blue


def _times(at_s: Floats, station_m: Floats) -> list[rr.TimeColumn]:
    since_start = np.round(at_s * 1e9).astype("timedelta64[ns]")
    furthest = np.maximum.accumulate(station_m)  # a car that rolls back stays where it was
    return [
        rr.TimeColumn(TIMELINE, duration=since_start),
        rr.TimeColumn(PLACE_TIMELINE, sequence=np.round(furthest).astype(np.int64)),
    ]


def _draw_road(recording: rr.RecordingStream, compared: ComparedTracks, tag_m: float) -> None:
    road, _ = road_with_marks(*compared.path, tag_m)
    recording.log("world/road/path", road, static=True)
    recording.log("world/road/lane", lane_edges(*compared.path, compared.lane_m), static=True)
    recording.log("world/plan", plan_frame(), static=True)


def _draw_car(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, tag_m: float
) -> None:
    entity = f"world/cars/{track.run}/{track.vehicle}"
    known = np.flatnonzero(np.isfinite(track.station_m))
    points = np.column_stack((track.east_m, track.north_m))
    driven = rr.LineStrips2D(
        [points[::CAR_STEP]], colors=[colour], radii=rr.Radius.ui_points(1.0), draw_order=5
    )
    recording.log(f"world/driven/{track.run}/{track.vehicle}", driven, static=True)
    recording.log(entity, car(CarShape(*track.body), colour), static=True)
    dot = rr.Points2D([[0, 0]], colors=[colour], radii=rr.Radius.ui_points(4.0), draw_order=19)
    recording.log(f"{entity}/dot", dot, static=True)
    name = rr.Points2D(
        [[0.0, tag_m]],
        colors=[colour],
        radii=0.0,
        labels=[f"{track.vehicle} {track.run}"],
        show_labels=True,
        draw_order=30,
    )
    recording.log(f"world/names/{track.run}/{track.vehicle}", name, static=True)
    rows = known[::CAR_STEP]
    if rows.size:
        poses = _poses(points[rows], track.yaw_rad[rows], mirrored=False)
        times = _times(track.at_s[rows], track.station_m[rows])
        recording.send_columns(entity, times, poses)
        recording.send_columns(f"world/names/{track.run}/{track.vehicle}", times, poses)


def _poses(points: Floats, yaw: Floats, *, mirrored: bool) -> Any:
    """Frames at points (N, 2) turned by yaw (rad), see `axes_of`."""
    at = np.column_stack((points, np.zeros(len(points))))
    cos, sin, none = np.cos(yaw), np.sin(yaw), np.zeros(len(points))
    if mirrored:  # a symmetric matrix
        matrix = np.column_stack((cos, sin, none, sin, -cos, none, none, none, none + 1.0))
        return rr.Transform3D.columns(translation=at, mat3x3=matrix)
    half = 0.5 * yaw
    turned = np.column_stack((none, none, np.sin(half), np.cos(half)))
    return rr.Transform3D.columns(translation=at, quaternion=turned)


def _draw_eye(recording: rr.RecordingStream, track: VehicleTrack) -> None:
    rows = np.flatnonzero(np.isfinite(track.station_m))[::CAR_STEP]
    points = np.column_stack((track.east_m, track.north_m))[rows]
    poses = _poses(points, track.yaw_rad[rows], mirrored=True)
    recording.send_columns("world/convoy", _times(track.at_s[rows], track.station_m[rows]), poses)


def _draw_curves(
    recording: rr.RecordingStream, track: VehicleTrack, colour: Colour, number: int
) -> None:
    for quantity, curve in track.curves.items():
        known = np.isfinite(curve.values) & np.isfinite(curve.station_m)
        if not known.any():
            continue
        entity = f"plots/{quantity}/{track.vehicle}/{track.run}"
        style = rr.SeriesLines(
            colors=[colour],
            names=[f"{track.vehicle} {track.run}"],
            widths=[2.5 if number == 0 else 1.5],
        )
        recording.log(entity, style, static=True)
        times = _times(curve.at_s[known], curve.station_m[known])
        recording.send_columns(entity, times, rr.Scalars.columns(scalars=curve.values[known]))


def _draw_modes(recording: rr.RecordingStream, track: VehicleTrack) -> None:
    modes = [one for one in track.modes if np.isfinite(one.station_m)]
    if not modes or not track.place:
        return
    entity = f"mode/{track.vehicle}_{track.run}"
    states = PANELS["mode"].states
    names = list(states)
    style = rr.StateConfiguration(values=names, labels=names, colors=list(states.values()))
    recording.log(entity, style, static=True)
    times = _times(
        np.array([one.at_s for one in modes]), np.array([one.station_m for one in modes])
    )
    recording.send_columns(entity, times, rr.StateChange.columns(state=[one.mode for one in modes]))


def _draw_divergence(recording: rr.RecordingStream, compared: ComparedTracks, tag_m: float) -> None:
    """Mark the first divergence in the plans and, on the zero line, in the plots of errors."""
    first = compared.divergence
    if first is None:
        return
    place = [[first.east_m, first.north_m]]
    spot = rr.Points2D(place, colors=[WORST], radii=rr.Radius.ui_points(7.0), draw_order=40)
    recording.log("world/divergence", spot, static=True)
    name = rr.Points2D(
        [[first.east_m, first.north_m + tag_m]],
        colors=[WORST],
        radii=0.0,
        labels=[f"first divergence, {first.station_m:.0f} m"],
        show_labels=True,
        draw_order=41,
    )
    recording.log("world/divergence/name", name, static=True)
    style = rr.SeriesPoints(
        colors=[WORST], markers=["Diamond"], names=["first divergence"], marker_sizes=[7.0]
    )
    times = _times(np.array([first.at_s]), np.array([first.station_m]))
    for quantity in ("error", "difference"):
        entity = f"plots/{quantity}/divergence"
        recording.log(entity, style, static=True)
        recording.send_columns(entity, times, rr.Scalars.columns(scalars=[0.0]))
