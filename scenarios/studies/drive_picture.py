"""Picture of a recorded drive: its plan, and its speed over the distance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scenarios.definition.check.drive_report import driven_m, speeds_mps
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.traces.reading import DriveInPlane
from scenarios.results.figure_style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_IN,
    PURPLE,
    RED,
    SKY,
    STYLE,
    write_picture,
)
from vehicles.geometry.geodesy import LocalPlane
from vehicles.geometry.sampled_path import FloatArray

PLAN_IN, SPEED_IN = (1.8, 4.5), 2.6
"""Smallest and largest height (inches) of the plan, and that of the speeds, title and legend."""
MARGIN, LEAST_EXTENT = 0.08, 20.0
"""Margin of the plan, a share of the drive's extent, and its smallest extent (m)."""
POINTS_MAX, MARKED_MAX = 3000, 500
"""Recorded points, and marks of one kind, that are drawn at most."""
RECORDED: Any = {"marker": "o", "markersize": 2.6, "markeredgewidth": 0.0, "color": "#a8a8a8"}
RECORDED |= {"linestyle": "none", "zorder": 1.5, "label": "recorded"}
DRIVEN: Any = {"color": BLUE, "linewidth": 1.1, "label": "driven by the lead"}
LEFT_OUT: Sequence[Any] = [
    {"marker": marker, "color": colour, "markersize": 6.0, "linestyle": "none"}
    for marker in ("x", "+", "1", "d")
    for colour in (RED, PURPLE, GREY)
]
PAUSED: Any = {"marker": "s", "color": "black", "markersize": 4.0, "linestyle": "none"}
SPEED_TITLES = {
    "recorded": "speed",
    "derived": "speed, from the recorded times",
    None: "speed, not recorded",
}


def draw_drive(drive: DriveInPlane, scenario: Scenario | None, path: Path) -> None:
    """Draw a drive into a new file: PNG, SVG or PDF by its extension.

    Raises FileExistsError, or ScenarioError for another extension.
    """
    write_picture(drive_figure(drive, scenario), path)


@mpl.rc_context(STYLE)
def drive_figure(drive: DriveInPlane, scenario: Scenario | None) -> Figure:
    """Draw a recorded drive, and how `scenario` drives it: None if it cannot be driven.

    Coordinates and distances count from the first point of the drive.
    """
    points, table = drive.points, drive.table
    start, along = points[:, :1], driven_m(drive, scenario)
    half = 0.5 * np.ptp(points, axis=1) + MARGIN * max(*np.ptp(points, axis=1), LEAST_EXTENT)
    height = float(np.clip((PAGE_IN - 0.7) * half[1] / half[0], *PLAN_IN))
    figure = Figure(figsize=(PAGE_IN, height + SPEED_IN), layout="constrained")
    plan, speed = figure.subplots(2, 1, height_ratios=(height, 0.65 * SPEED_IN))
    plan.plot(*_thinned(drive.record_m - start), **RECORDED)
    speeds, source = speeds_mps(drive, along)
    speed.plot(*_thinned(np.stack((along[: len(speeds)], speeds[: len(along)]))), **RECORDED)
    driven = points - start
    if scenario is not None and scenario.route.smoothed is not None:
        driven = _draw_planned(plan, speed, scenario, start)
    for style, (kind, count) in zip(LEFT_OUT, drive.left_out.counts.most_common(), strict=False):
        places = _places(drive, kind)[:, :MARKED_MAX] - start
        plan.plot(*places, label=f"{kind}: {count}", **style)
    _draw_ends(plan, driven)
    if table.pause_points:
        numbers = np.array(table.pause_points)
        plan.plot(*(points - start)[:, numbers], **PAUSED, label="pause")
        at = along[np.minimum(numbers, len(along) - 1)]  # a lap ends before the recording
        speed.plot(at, np.zeros(numbers.size), **PAUSED, clip_on=False, zorder=3)
    middle = 0.5 * (points.min(axis=1) + points.max(axis=1)) - start[:, 0]
    plan.set(xlabel="east of the start, m", ylabel="north, m")
    plan.set(xlim=middle[0] + (-half[0], half[0]), ylim=middle[1] + (-half[1], half[1]))
    plan.set_aspect("equal")
    speed.set_title(SPEED_TITLES[source], loc="left")
    speed.set(xlabel="distance, m", ylabel="speed, m/s", ylim=(0.0, max(1.0, speed.get_ylim()[1])))
    speed.set_xlim(0.0, max(float(along[-1]), 1.0))
    duration = f", {table.time_s[-1]:.0f} s" if table.time_s else ""
    plan.set_title(f"{Path(table.source).name}: {along[-1]:.0f} m{duration}", loc="left")
    figure.legend(*plan.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _draw_planned(plan: Axes, speed: Axes, scenario: Scenario, start: FloatArray) -> FloatArray:
    """Draw path and speed of the lead, and the holes in them; return the path (2, n)."""
    route, table = scenario.route, scenario.tables.path
    profile, road = route.profile, route.smoothed
    if road is None or not isinstance(table, PointsPath):
        return start - start
    on_drive = route.path.station >= road.start
    path = np.stack((route.path.east - table.east_m[0], route.path.north - table.north_m[0]))
    path, along = path[:, on_drive], route.path.station[on_drive] - road.start
    plan.plot(*path, **DRIVEN)
    times = np.unique(np.append(profile.times, scenario.duration_s))
    times = times[times <= scenario.duration_s].tolist()
    driven = [route.start - road.start + profile.distance(time) for time in times]
    speed.plot(driven, [profile.at(time)[0] for time in times], **DRIVEN)
    for k, hole in enumerate(road.holes[:MARKED_MAX]):
        begin, end = road.stations[hole.point : hole.point + 2] - road.start
        part = slice(*np.searchsorted(along, (begin, end)).tolist())
        label = None if k else "hole: the road is a guess"
        plan.plot(*path[:, part], color=ORANGE, linewidth=3.0, label=label)
        speed.axvspan(begin, end, color=ORANGE, alpha=0.25, linewidth=0)
    return path


def _thinned(points: FloatArray) -> FloatArray:
    return points[:, :: points.shape[1] // POINTS_MAX + 1]


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
    ahead, begin = driven[:, int(np.argmax(away >= reach))].tolist(), driven[:, 0].tolist()
    arrow = {"arrowstyle": "-|>", "color": GREEN, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", ahead, begin, arrowprops=arrow, zorder=4)
    axes.plot(*begin, "o", color=GREEN, markersize=5.0, zorder=4, label="start")
    axes.plot(*driven[:, -1], "o", color=SKY, markersize=5.0, zorder=3.5, label="end")
