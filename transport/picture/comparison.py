"""The vehicles of several runs as arrays, for their common picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from transport.panels import PANELS, Colour, colour_of
from transport.picture.blueprint import TIMELINE, WORST, Reach, Road, legend_view
from transport.picture.shapes import CarShape, car, lane_edges, legend, plan_frame, road_with_marks

Floats = NDArray[np.float64]


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
    """The first place at which two runs differ, with a sentence about it."""

    vehicle: str
    at_s: float
    station_m: float
    east_m: float
    north_m: float
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedTracks:
    """All that the picture of several runs shows.

    `path` is east and north of the common path (m), `lane_m` the width of its lane, `spacing_m` the
    usual spacing of two vehicles, and `text` a description in Markdown.
    """

    vehicles: Sequence[str]
    tracks: Sequence[VehicleTrack]
    path: tuple[Sequence[float], Sequence[float]]
    lane_m: float
    spacing_m: float
    divergence: DivergencePoint | None
    text: str


# ---- Layout of the picture of several runs
#
# Entities: `world/…` as in the picture of one run, with the runs' labels below `cars` and `driven`;
# `plots/<quantity>/<vehicle>/<run>`, `plots/<quantity>/divergence`, `mode/<vehicle>_<run>`.


PLACE_TIMELINE = "path_m"  # Whole metres along the path of the first run
PLOTS = {
    "error": "Error from the lead's path (m, left positive)",
    "difference": "Offset minus that of A at the same place (m)",
    "gap": "Gap to the vehicle ahead (m)",
}


def comparison_blueprint(
    vehicles: Sequence[str], *, spacing_m: float, road: Road, runs: int
) -> rrb.Blueprint:
    """Layout for runs of `vehicles`, lead first, that drive about `spacing_m` apart on `road`."""
    reach = Reach.of(len(vehicles), spacing_m, road)
    east, north = road
    margin = 0.04 * max(max(east) - min(east), max(north) - min(north))
    followers = max(len(vehicles) - 1, 1)
    # On another timeline a fixed range would be one of nanoseconds.
    whole = rr.TimeRange(start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite())
    time_axis = rrb.TimeAxis(view_range=whole)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial2DView(
                    name="Convoys (driving to the right, A is faded)",
                    origin="world/convoy",
                    contents=["/world/**", "- /world/divergence/name"],
                    visual_bounds=rrb.VisualBounds2D(
                        x_range=[-reach.behind, reach.ahead],
                        y_range=[-reach.lateral, reach.lateral],
                    ),
                ),
                rrb.Spatial2DView(
                    name="Plan (north up)",
                    origin="world/plan",
                    contents=["/world/**", "- /world/names/**"],
                    visual_bounds=rrb.VisualBounds2D(
                        x_range=[min(east) - margin, max(east) + margin],
                        y_range=[-max(north) - margin, -min(north) + margin],
                    ),
                ),
                legend_view(),
                rrb.TextDocumentView(name="Runs", origin="text"),
                row_shares=[3, 3, 0.72, 3],
            ),
            rrb.Vertical(
                *(
                    rrb.TimeSeriesView(
                        name=heading,
                        origin=f"plots/{quantity}",
                        plot_legend=rrb.PlotLegend(visible=False),
                        axis_x=time_axis,
                    )
                    for quantity, heading in PLOTS.items()
                ),
                rrb.StateTimelineView(name="Modes", origin="mode", time_view=time_axis),
                row_shares=[4, 4, 3, min(2.0 + 0.6 * followers * runs, 9.0)],
            ),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, expanded=False),
        rrb.SelectionPanel(expanded=False),
        rrb.BlueprintPanel(expanded=False),
        auto_layout=False,
        auto_views=False,
    )


# ---- Draws several runs into one recording: each value has a time and a distance along the path


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
