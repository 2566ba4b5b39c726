"""Picture of a recorded drive: its plan, and its speed over the distance. Needs matplotlib."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.check.drive_report import driven_m, speeds_mps
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.results.files import write_whole
from scenarios.studies.picture_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    PURPLE,
    RED,
    SKY,
    STYLE,
    encoded,
    picture_format_of,
)
from vehicles.geometry.geodesy import LocalPlane
from vehicles.geometry.sampled_path import FloatArray

PLAN_IN, SPEED_IN = (1.8, 4.5), 2.6
"""Smallest and largest height (inches) of the plan, and that of the speeds, title and legend."""

MARGIN, LEAST_EXTENT = 0.08, 20.0
"""Margin of the plan, a share of the drive's extent, and its smallest extent (m). Points outside
are only counted."""

CELLS, MOST_POINTS, MOST_MARKED = 1500, 3000, 500
"""Number of cells across the plan in which points are drawn once, of points in a line, and of
records left out for one reason."""

RECORDED: Any = {"marker": "o", "markersize": 2.6, "markeredgewidth": 0.0, "color": "#a8a8a8"}
RECORDED |= {"linestyle": "none", "zorder": 1.5, "label": "recorded"}
DRIVEN: Any = {"color": BLUE, "linewidth": 1.1, "label": "driven by the lead"}
LEFT_OUT: Sequence[Any] = [
    {"marker": marker, "color": colour, "markersize": 6.0, "linestyle": "none"}
    for marker in ("x", "+", "1", "d")
    for colour in (RED, PURPLE, GREY)
]
SPEED_TITLES = {
    "recorded": "speed",
    "derived": "speed, from the recorded times",
    None: "speed, not recorded",
}
PAUSED: Any = {"marker": "s", "color": "black", "markersize": 4.0, "linestyle": "none"}


@dataclass(frozen=True, slots=True)
class _Planned:
    """Path of the lead at distances `along` (m), its holes, and its speed over the distance."""

    path: FloatArray
    along: FloatArray
    holes: Sequence[tuple[float, float]]
    speed: FloatArray


def draw_drive(drive: DriveInPlane, scenario: Scenario | None, path: Path) -> None:
    """Draw a drive into a new file: PNG, SVG or PDF by its extension.

    Raises FileExistsError, or ScenarioError for another extension.
    """
    picture_format = picture_format_of(path)
    write_whole(path, encoded(drive_figure(drive, scenario), picture_format), new=True)


@mpl.rc_context(STYLE)
def drive_figure(drive: DriveInPlane, scenario: Scenario | None) -> Figure:
    """Draw a recorded drive, and how `scenario` drives it: None if it cannot be driven.

    Coordinates and distances count from the first point of the drive.
    """
    points = np.stack((drive.east_m, drive.north_m))
    along = driven_m(drive, scenario)
    planned = _planned(scenario) if scenario is not None else None
    box = _box(points - points[:, :1])
    wide, high = np.ptp(box, axis=1)
    plan_in = float(np.clip((PAGE_IN - 0.7) * high / wide, *PLAN_IN))
    figure = Figure(figsize=(PAGE_IN, plan_in + SPEED_IN), layout="constrained")
    plan, speed = figure.subplots(2, 1, height_ratios=(plan_in, 0.65 * SPEED_IN))
    _draw_plan(plan, drive, planned, box)
    _draw_pauses(plan, speed, drive, along)
    _draw_speed(speed, drive, planned, along)
    duration = f", {drive.time_s[-1]:.0f} s" if len(drive.time_s) else ""
    plan.set_title(f"{drive.source}: {along[-1]:.0f} m{duration}", loc="left")
    named: dict[str, Artist] = {}
    for axes in (plan, speed):
        handles, names = axes.get_legend_handles_labels()
        named |= dict(zip(names, handles, strict=True))
    figure.legend(list(named.values()), list(named), loc="outside upper center", ncols=4)
    return figure


def _planned(scenario: Scenario) -> _Planned | None:
    route, table = scenario.route, scenario.tables.path
    profile, road = route.profile, route.smoothed
    if road is None or not isinstance(table, PointsPath):
        return None
    driven = route.path.station >= road.start
    path = np.stack((route.path.east - table.east_m[0], route.path.north - table.north_m[0]))
    holes = [(road.stations[hole.point], road.stations[hole.point + 1]) for hole in road.holes]
    times = np.unique(np.append(profile.times, scenario.duration_s))
    times = times[times <= scenario.duration_s]
    speeds = np.interp(times, profile.times, profile.speeds)
    distance = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times)))
    return _Planned(
        path=path[:, driven],
        along=route.path.station[driven] - road.start,
        holes=[(begin - road.start, end - road.start) for begin, end in holes],
        speed=np.stack((route.start - road.start + distance, speeds)),
    )


def _box(points: FloatArray) -> FloatArray:
    """Limits (m) of the plan: least and most of east and north, shape (2, 2)."""
    least, most = points.min(axis=1), points.max(axis=1)
    margin = MARGIN * max(float(np.max(most - least)), LEAST_EXTENT)
    return np.stack((least - margin, most + margin), axis=1)


def _thinned(points: FloatArray, cell: float | FloatArray) -> FloatArray:
    """Drop points (2, n) in the `cell` of their predecessor, and evenly above MOST_POINTS."""
    cells = np.floor(points / cell)
    kept = np.any(np.diff(cells, axis=1, prepend=np.nan) != 0.0, axis=0)
    kept[-1:] = True
    return points[:, kept][:, :: int(kept.sum()) // MOST_POINTS + 1]


def _draw_plan(axes: Axes, drive: DriveInPlane, planned: _Planned | None, box: FloatArray) -> None:
    start = np.array((drive.east_m[0], drive.north_m[0]))[:, None]
    driven = np.stack((drive.east_m, drive.north_m)) - start
    cell = float(np.max(np.ptp(box, axis=1))) / CELLS
    axes.plot(*_thinned(_inside(drive.record_m - start, box), cell), **RECORDED)
    if planned is not None:
        driven = planned.path
        axes.plot(*_thinned(driven, cell), **DRIVEN)
        _draw_holes(axes, planned, cell)
    _draw_left_out(axes, drive, start, box)
    _draw_ends(axes, driven)
    axes.set(xlabel="east of the start, m", ylabel="north, m")
    axes.margins(0.0)
    axes.update_datalim(box.T)
    axes.set_aspect("equal", adjustable="datalim")


def _inside(points: FloatArray, box: FloatArray) -> FloatArray:
    return points[:, np.all((points >= box[:, :1]) & (points <= box[:, 1:]), axis=0)]


def _draw_holes(axes: Axes, planned: _Planned, cell: float) -> None:
    gap = np.full((2, 1), np.nan)
    parts = []
    for begin, end in planned.holes[:MOST_MARKED]:
        first, last = np.searchsorted(planned.along, (begin, end)).tolist()
        parts += [_thinned(planned.path[:, first : last + 1], cell), gap]
    if parts:
        holes = np.concatenate(parts, axis=1)
        axes.plot(*holes, color=ORANGE, linewidth=3.0, label="hole: the road is a guess")


def _draw_left_out(axes: Axes, drive: DriveInPlane, start: FloatArray, box: FloatArray) -> None:
    """Mark faults by their kind; those outside the plan, or nowhere, are counted."""
    for style, (kind, count) in zip(LEFT_OUT, drive.left_out.counts.most_common(), strict=False):
        places = _inside(_places(drive, kind) - start, box)
        beyond = count - places.shape[1]
        label = f"{kind}: {count}" + (f" ({beyond} not shown)" if beyond else "")
        axes.plot(*places[:, :MOST_MARKED], label=label, **style)


def _places(drive: DriveInPlane, kind: str) -> FloatArray:
    """Return the places (2, n) of records left out, in the plane; NaN where unknown."""
    places = [record.position for record in drive.left_out.records if record.kind == kind]
    positions = np.array(places, dtype=float).reshape(-1, 2).T
    if drive.origin is None:
        return positions
    plane = LocalPlane(drive.origin)
    return plane.to_plane_all(positions[0], positions[1], drive.origin.altitude_m)


def _draw_ends(axes: Axes, driven: FloatArray) -> None:
    reach = 0.06 * float(np.max(np.ptp(driven, axis=1)))
    away = np.hypot(*(driven - driven[:, :1]))
    ahead = driven[:, int(np.argmax(away >= reach))]
    arrow = {"arrowstyle": "-|>", "color": GREEN, "shrinkA": 0.0, "shrinkB": 0.0}
    begin = driven[:, 0]
    axes.annotate("", _pair(ahead), _pair(begin), arrowprops=arrow, zorder=4)
    axes.plot(*begin, "o", color=GREEN, markersize=5.0, zorder=4, label="start")
    axes.plot(*driven[:, -1], "o", color=SKY, markersize=5.0, zorder=3.5, label="end")


def _pair(place: FloatArray) -> tuple[float, float]:
    return float(place[0]), float(place[1])


def _draw_pauses(plan: Axes, speed: Axes, drive: DriveInPlane, along: FloatArray) -> None:
    if not drive.pauses:
        return
    numbers = [pause.point for pause in drive.pauses]
    points = np.stack((drive.east_m, drive.north_m))
    places = (points - points[:, :1])[:, numbers]
    plan.plot(*places, **PAUSED, label="pause")
    at = along[np.minimum(numbers, len(along) - 1)]  # a lap ends before the recording
    speed.plot(at, np.zeros(len(numbers)), **PAUSED, clip_on=False, zorder=3)


def _draw_speed(
    axes: Axes, drive: DriveInPlane, planned: _Planned | None, along: FloatArray
) -> None:
    speeds, source = speeds_mps(drive, along)
    lines = [(np.stack((along[: len(speeds)], speeds[: len(along)])), RECORDED)]
    if planned is not None:
        lines.append((planned.speed, DRIVEN))
        for begin, end in planned.holes[:MOST_MARKED]:
            axes.axvspan(begin, end, color=ORANGE, alpha=0.25, linewidth=0)
    highest = max(1.0, *(float(np.max(line[1], initial=0.0)) for line, _ in lines))
    length = max(float(along[-1]), 1.0)
    cells = np.array([[length], [highest]]) / CELLS
    for line, style in lines:
        axes.plot(*_thinned(line, cells), **style)
    axes.set_title(SPEED_TITLES[source], loc="left")
    axes.set(xlabel="distance, m", ylabel="speed, m/s", ylim=(0.0, 1.08 * highest))
    axes.set_xlim(0.0, length)
