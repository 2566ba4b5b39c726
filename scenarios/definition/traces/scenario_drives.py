"""Recorded drives of a scenario: the lead's, and those of replayed vehicles."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.library import TRACES, exists
from scenarios.definition.schema.path_tables import PointsPath, TracePath
from scenarios.definition.schema.scenario_tables import OriginTable, ScenarioTables, VehicleTable
from scenarios.definition.traces.reading import DriveInPlane, OnDrive, read_trace
from scenarios.definition.traces.recorded_drive import DrivenPart, PartError, TraceError
from vehicles.geometry.bridges import step_lengths
from vehicles.geometry.geodesy import REACH, Origin
from vehicles.geometry.smoothing import MERGED_NOISE

FAR = 10_000.0
"""Distance (m) from the origin beyond which coordinates are those of a map, such as UTM, and are
shifted to the origin. With an origin in the scenario it is the reach of the plane."""

CURVATURE_NOISE = 0.004
"""Largest noise of curvature (1/m) after smoothing: 0.4 m/s² of lateral acceleration at 10 m/s."""

LATERAL_NOISE = 0.1
"""Largest noise of lateral acceleration (m/s²) in a drive that is fast throughout."""

HARD_BEND = 4.0
"""Lateral acceleration (m/s²) of a drive in its tightest bends."""

SLOW_RATIO, SPEED_SPAN_S = 0.05, 2.0
"""Share of the points that are slower than a drive is throughout, and time (s) of their speeds."""

WIDEST = 500.0
"""Largest half width (m) of the smoothing."""

NARROWER = (32.0, 16.0, 8.0, 5.0, 3.0)
"""Half widths of the smoothing (m) tried where a car cannot drive the path at the automatic one."""

ELSEWHERE = 5_000.0
"""Largest distance (m) of a second drive from the start of the lead's."""


def with_points(
    tables: ScenarioTables, folder: Path, on_drive: OnDrive = lambda _: None
) -> ScenarioTables:
    """Replace a trace by its points, and fill in the origin; raises SettingError.

    A trace is searched in `folder`, then among the shipped ones. Without an origin in the scenario
    the plane touches the earth at the first point.
    """
    table = tables.path
    given = Origin(**tables.origin.model_dump()) if tables.origin else None
    if isinstance(table, TracePath):
        part = DrivenPart(table.from_s, table.to_s, table.from_m, table.to_m)
        try:
            trace = read_trace(
                _file(table.file, folder),
                origin=given,
                vehicle=table.vehicle,
                topic=table.topic,
                part=part,
                pauses=table.pauses,
                on_drive=on_drive,
            )
        except PartError as error:
            raise SettingError(error.key, str(error)) from error
        except TraceError as error:
            raise SettingError("path.file", str(error)) from error
        given = trace.origin or given
        table = points_of(trace, table)
    if isinstance(table, PointsPath):
        table = _laid_near(table, REACH if tables.origin else FAR)
    return tables.model_copy(update={"origin": _origin_table(given), "path": table})


def at_recorded_speed(tables: ScenarioTables) -> ScenarioTables:
    """Set the recorded speed if the drive has times, unless another speed is configured."""
    table, speed = tables.path, tables.speed
    is_configured = speed.model_fields_set & {"lead", "set_mps", "profile"}
    if not isinstance(table, PointsPath) or not len(table.time_s) or table.closed or is_configured:
        return tables
    recorded = speed.model_copy(update={"lead": "recorded"})
    return tables.model_copy(update={"speed": recorded})


def with_replays(tables: ScenarioTables, folder_of: Callable[[str], Path]) -> ScenarioTables:
    """Read the drives of replayed vehicles into the lead's plane; raises SettingError.

    `folder_of` returns the folder in which the file of a key is searched.
    """
    read = {
        name: own.model_copy(update={"drive": _second(tables, name, own, folder_of)})
        for name, own in tables.vehicle.items()
        if own.replay is not None and own.drive is None
    }
    return tables.model_copy(update={"vehicle": {**tables.vehicle, **read}}) if read else tables


def _second(
    tables: ScenarioTables, name: str, own: VehicleTable, folder_of: Callable[[str], Path]
) -> PointsPath:
    key, lead = f"vehicle.{name}.replay", tables.path
    origin = Origin(**(tables.origin or OriginTable()).model_dump())
    table = TracePath(kind="trace", file=own.replay or "")
    try:
        trace = read_trace(
            _file(table.file, folder_of(key)),
            origin=origin,
            vehicle=own.replay_vehicle,
            topic=own.replay_topic,
            part=DrivenPart(own.replay_from_s, own.replay_to_s, keys=f"{key}_"),
            needs_times=True,
        )
    except PartError as error:
        raise SettingError(error.key, str(error)) from error
    except TraceError as error:
        raise SettingError(key, str(error)) from error
    points = points_of(trace, table)
    if not isinstance(lead, PointsPath):
        return points
    if lead.source and lead.geodetic != (trace.origin is not None):
        kinds = "latitudes" if lead.geodetic else "plane coordinates"
        raise SettingError(
            key, f"{table.file}: given in another plane, allowed {kinds} as {lead.source} has"
        )
    if trace.origin is None:
        points = _moved(points, lead.east_offset_m, lead.north_offset_m)
    east, north = lead.east_m[0], lead.north_m[0]
    away = min(
        math.hypot(x - east, y - north) for x, y in zip(points.east_m, points.north_m, strict=True)
    )
    if away > ELSEWHERE:
        raise SettingError(
            key,
            f"{table.file}: its closest point is {away / 1000.0:.1f} km from the start of the "
            f"lead's path, allowed at most {ELSEWHERE / 1000.0:g} km: is it the same road?",
        )
    return points


def points_of(trace: DriveInPlane, table: TracePath) -> PointsPath:
    """Return the points of a trace; smoothing defaults to what their noise requires."""
    smoothing, narrower = table.smoothing_m, tuple[float, ...]()
    if "smoothing_m" not in table.model_fields_set:
        smoothing = max(smoothing, _needed_smoothing(trace))
        narrower = tuple(width for width in NARROWER if width < smoothing)
    fields: dict[str, Any] = {key: getattr(trace, key) for key in _KEPT}
    fields |= {key: tuple(getattr(trace, key).tolist()) for key in _COLUMNS}
    return PointsPath(
        kind="points",
        source=table.file,
        left_out=trace.left_out_lines,
        geodetic=trace.origin is not None,
        remarks=trace.remarks,
        smoothing_m=smoothing,
        narrower_m=narrower,
        pause_points=tuple(pause.point for pause in trace.pauses),
        pause_lasts_s=tuple(pause.lasts_s for pause in trace.pauses),
        pause_lost_s=tuple(pause.lost_s for pause in trace.pauses),
        pauses="cut" if trace.pauses_cut else "keep",
        **fields,
        **table.model_dump(include={"closed", "laps"}),
    )


def _needed_smoothing(trace: DriveInPlane) -> float:
    """Return the half width (m) that reduces noise to CURVATURE_NOISE; see `smooth_path`.

    A fast drive has wide bends only. There it also reduces noise to LATERAL_NOISE, up to half the
    smallest radius.
    """
    steps = step_lengths(np.array((trace.east_m, trace.north_m)))
    moved = steps[steps > 0.0]
    spacing = max(float(np.median(moved)) if moved.size else 0.0, MERGED_NOISE * trace.noise_m)
    kept = 20.0 * trace.noise_m * math.sqrt(spacing)
    square = _slow_speed(trace) ** 2
    fast = min(math.pow(kept * square / LATERAL_NOISE, 0.4), 0.5 * square / HARD_BEND)
    width = max(math.pow(kept / CURVATURE_NOISE, 0.4), fast)
    return min(float(math.ceil(width)), WIDEST)


def _slow_speed(trace: DriveInPlane) -> float:
    """Speed (m/s) over SPEED_SPAN_S that a drive nearly always exceeds; 0 without times."""
    times = trace.time_s
    first = np.arange(np.searchsorted(times, times[-1:] - SPEED_SPAN_S).sum())
    if not first.size:
        return 0.0
    last = np.searchsorted(times, times[first] + SPEED_SPAN_S)
    moved = np.hypot(*(one[last] - one[first] for one in (trace.east_m, trace.north_m)))
    return float(np.quantile(moved / (times[last] - times[first]), SLOW_RATIO))


_KEPT = (
    "clock", "epoch_s", "source_unit", "begin_s", "begin_m", "noise_m", "skipped_lines",
    "jumping_points", "standing_points",
)  # fmt: skip
_COLUMNS = ("east_m", "north_m", "time_s", "speed_mps", "source_numbers")
"""Fields that points take from their drive."""


def _laid_near(table: PointsPath, far: float) -> PointsPath:
    """Shift points that begin further than `far` m from the origin to it."""
    if not table.east_m or not table.north_m:
        return table
    if math.hypot(table.east_m[0], table.north_m[0]) <= far:
        return table
    moved = _moved(table, float(round(table.east_m[0])), float(round(table.north_m[0])))
    east, north = moved.east_offset_m, moved.north_offset_m
    remark = (
        f"the coordinates begin {math.hypot(east, north) / 1000.0:.0f} km from their origin: "
        f"{east:.0f} m are subtracted from all eastings, {north:.0f} m from all northings"
    )
    return moved.model_copy(update={"remarks": (*table.remarks, remark)})


def _moved(table: PointsPath, east: float, north: float) -> PointsPath:
    return table.model_copy(
        update={
            "east_m": tuple(x - east for x in table.east_m),
            "north_m": tuple(y - north for y in table.north_m),
            "east_offset_m": table.east_offset_m + east,
            "north_offset_m": table.north_offset_m + north,
        }
    )


def _file(given: str, folder: Path) -> Path:
    own, shipped = folder / given, TRACES / given
    return shipped if exists(shipped) and not exists(own) else own


def _origin_table(origin: Origin | None) -> OriginTable:
    if origin is None:
        return OriginTable()
    return OriginTable(
        latitude_deg=origin.latitude_deg,
        longitude_deg=origin.longitude_deg,
        altitude_m=origin.altitude_m,
    )
