"""Recorded drives of a scenario, the lead's and those of replayed vehicles, as points."""

import math
from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.library import TRACES, exists
from scenarios.definition.schema.path_tables import PointsPath, TracePath
from scenarios.definition.schema.scenario_tables import OriginTable, ScenarioTables, VehicleTable
from scenarios.definition.traces.cleaning import Cleaned, cleaned, pauses_in, without_repeats
from scenarios.definition.traces.drawn_line import are_vertices, between_vertices
from scenarios.definition.traces.drive import (
    JUMP,
    NO_TIMES,
    DrivenPart,
    DriveTable,
    Floats,
    LeftOutRecords,
    PartError,
    TraceError,
    bounds,
    listed_parts,
    recorded_times,
)
from scenarios.definition.traces.formats.registry import read_recorded
from scenarios.definition.traces.positions import FAR, usable_positions
from scenarios.definition.traces.recorded_speeds import usable_speeds
from scenarios.definition.traces.time_order import in_time_order
from vehicles.geometry.bridges import distances_along, noise_deviation, step_lengths
from vehicles.geometry.geodesy import REACH, LocalPlane, Origin
from vehicles.geometry.smoothing import MERGED_NOISE, MIN_POINTS

# ---- Reading


LEAST_EXTENT = 1.0
"""Smallest extent (m) of a path."""

RADIAN_RATIOS = (20.0, 60.0)
"""Recorded speed over that of positions in radians that are taken for degrees."""

ALTITUDES_M = (-500.0, 10_000.0)
"""Range of usable altitudes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveInPlane:
    """The points of a recorded drive that are driven, and its record.

    The plane is that of `origin` (None: the file has plane coordinates). `record_m` (2, n) are the
    positions (m) of all records with a usable place; `left_out` lists the others, and jumps.
    """

    table: PointsPath
    format_name: str
    origin: Origin | None
    record_m: Floats
    left_out: LeftOutRecords

    @property
    def points(self) -> Floats:
        return np.array((self.table.east_m, self.table.north_m))


OnDrive = Callable[[DriveInPlane], None]


def read_trace(
    path: Path,
    table: TracePath | None = None,
    *,
    origin: Origin | None = None,
    keys: str = "path.",
    needs_times: bool = False,
    on_drive: OnDrive = lambda _: None,
) -> DriveInPlane:
    """Read the recorded drive at `path` into the plane of `origin`, by default its first point.

    `table` selects vehicle, topic and part; the names of the keys of the part begin with `keys`.
    Unusable records are left out and listed. Raises TraceError with a line that starts with the
    file, also for a drive without times if it `needs_times`; `on_drive` receives also a drive that
    has no path.
    """
    table = table or TracePath(kind="trace", file=path.name)
    part = DrivenPart(table.from_s, table.to_s, table.from_m, table.to_m, keys)
    try:
        drive = usable_positions(read_recorded(path, vehicle=table.vehicle, topic=table.topic))
        drive = in_time_order(drive)
        if needs_times:
            _require_times(drive)
        drive = without_repeats(drive)
        plane = origin or _first_point(drive) if drive.geodetic else None
        points = _in_plane(drive, plane) if plane else drive.position
        _refuse_radians(drive, points)
        clean = cleaned(points, drive.times)
        for jump in clean.jumps:
            for k in range(jump.first, jump.last + 1):
                drive.list_fault(k, JUMP, f"jumps by {jump.size:.1f} m")
        read = DriveInPlane(
            table=_points_path(table, replace(drive, position=points), clean, part),
            format_name=drive.format_name,
            origin=plane,
            record_m=points,
            left_out=drive.left_out,
        )
        on_drive(read)
        _check_shape(read, keys)
    except TraceError as error:
        error.args = (f"{path}: {error}",)
        raise
    return read


def _require_times(drive: DriveTable) -> None:
    if not drive.times.size:
        reasons = [f", {text}" for text in drive.remarks if text.endswith(NO_TIMES)]
        raise TraceError("given without times, allowed only with them" + "".join(reasons[:1]))


def _points_path(
    table: TracePath, drive: DriveTable, clean: Cleaned, part: DrivenPart
) -> PointsPath:
    """Return the kept points of `part`; positions of `drive` are in the plane (m)."""
    times, kept = drive.times, clean.kept
    zero = float(times[kept[0]]) if times.size else 0.0
    since_start, along = times[kept] - zero if times.size else times, distances_along(clean.points)
    chosen = part.points(since_start, along)
    sound = np.ones(drive.count, dtype=bool)
    for jump in clean.jumps:
        sound[jump.first : jump.last + 1] = False
    at = times[sound] if times.size else times
    usable, remarks = usable_speeds(drive.speed_mps[sound], at, drive.position[:, sound])
    kept, points = kept[chosen], clean.points[:, chosen]
    within = [s.wander for s in clean.stands if kept[0] <= s.first and s.last <= kept[-1]]
    noise = clean.noise
    if part != DrivenPart(keys=part.keys):
        noise = max([noise_deviation(points), *within])
    if not times.size and are_vertices(points):
        remarks += (f"a smooth line through {kept.size} points without times, far apart",)
        points, before = between_vertices(points)
        kept, noise = kept[before], 0.0
    speeds = np.zeros(0)
    if usable is not None:  # 0 at standstill
        column = np.full(drive.count, np.nan)
        column[sound] = usable
        column[[k for stand in clean.stands for k in (stand.first, stand.last)]] = 0.0
        speeds = column[kept]
    since_part = since_start[chosen] - since_start[chosen][:1]
    pauses = pauses_in(points, since_part)
    stands = _stand_remarks(clean, drive, zero, {int(kept[pause.point]) for pause in pauses})
    if table.pauses == "cut" and pauses:
        lost = np.zeros(since_part.size)
        lost[[pause.point + 1 for pause in pauses]] = [pause.lost_s for pause in pauses]
        driven = since_part - np.cumsum(lost)
    else:
        driven = since_part
    smoothing, narrower = table.smoothing_m, tuple[float, ...]()
    if "smoothing_m" not in table.model_fields_set:
        smoothing = max(smoothing, _needed_smoothing(points, noise, driven))
        narrower = tuple(width for width in NARROWER if width < smoothing)
    jumping = sum(jump.last - jump.first + 1 for jump in clean.jumps)
    return PointsPath(
        kind="points",
        source=table.file,
        geodetic=drive.geodetic,
        clock=drive.clock if times.size else None,
        epoch_s=drive.zero_s + float(times[kept[0]]) if times.size else 0.0,
        source_unit=drive.unit,
        source_numbers=tuple(drive.numbers[kept].tolist()),
        begin_s=float(since_start[chosen][0]) if times.size else 0.0,
        begin_m=float(along[chosen][0]),
        pause_points=tuple(pause.point for pause in pauses),
        pause_lasts_s=tuple(pause.lasts_s for pause in pauses),
        pause_lost_s=tuple(pause.lost_s for pause in pauses),
        pauses=table.pauses,
        noise_m=noise,
        jumping_points=jumping,
        standing_points=sum(stand.last - stand.first + 1 for stand in clean.stands),
        remarks=(*drive.remarks, *stands, *remarks),
        skipped_lines=drive.left_out.counts.total() - jumping,
        left_out=drive.left_out.lines(drive.unit, zero),
        smoothing_m=smoothing,
        narrower_m=narrower,
        east_m=tuple(points[0].tolist()),
        north_m=tuple(points[1].tolist()),
        time_s=tuple(driven.tolist()),
        speed_mps=tuple(speeds.tolist()),
        closed=table.closed,
        laps=table.laps,
    )


def _stand_remarks(
    clean: Cleaned, drive: DriveTable, zero: float, paused: Container[int]
) -> Iterator[str]:
    """Describe standstills, except pauses, after `paused` points; times count from `zero` (s)."""
    times = drive.times - zero

    def where(k: int) -> str:
        place = f"{drive.unit} {drive.numbers[k]}"
        return f"{place} ({times[k]:.1f} s)" if times.size else place

    for stand in clean.stands:
        first, last = stand.first, stand.last
        span = f" for {times[last] - times[first]:.0f} s" if times.size else ""
        count = last - first + 1
        if first == 0:
            begin = where(last)
            yield f"the drive starts at its first movement, at {begin}: {count} points left out"
        elif last == drive.count - 1:
            yield f"the drive ends where it stops, at {where(first)}: {count} points left out"
        elif first not in paused:
            yield f"the car stands{span} from {where(first)} on: {count} points become one place"


def _first_point(drive: DriveTable) -> Origin:
    latitude, longitude = drive.position[:, 0].tolist()
    altitudes = drive.altitude_m
    usable = altitudes[(altitudes >= ALTITUDES_M[0]) & (altitudes <= ALTITUDES_M[1])]
    if not abs(latitude) <= 89.0:
        place = f"{drive.unit} {drive.numbers[0]}"
        raise TraceError(f"{place}: latitude {latitude:g} deg, allowed -89 to 89")
    altitude = float(usable[0]) if usable.size else 0.0
    return Origin(latitude, (longitude + 180.0) % 360.0 - 180.0, altitude)


def _in_plane(drive: DriveTable, origin: Origin) -> Floats:
    """Project points into the plane at the origin's height, to ignore noise in height."""
    plane = LocalPlane(origin)
    points = plane.to_plane_all(drive.position[0], drive.position[1], origin.altitude_m)
    for k in np.flatnonzero(np.isnan(points[0]))[:1].tolist():
        latitude, longitude = drive.position[:, k].tolist()
        try:
            plane.to_plane(latitude, longitude, origin.altitude_m)
        except ValueError as error:
            raise TraceError(f"{drive.unit} {drive.numbers[k]}: {error}") from error
    return points


def _refuse_radians(drive: DriveTable, points: Floats) -> None:
    """Raise TraceError for small angles whose recorded speeds are 57 times too large for them.

    East-west, their ratio is smaller by the cosine of the true latitude.
    """
    in_range = bool(np.all((0.5 * math.pi, math.pi) > np.abs(drive.position).T))
    if not drive.geodetic or not drive.times.size or not in_range:
        return
    driven = float(np.nansum(np.diff(drive.times) * np.abs(drive.speed_mps[1:])))
    ratio = driven / max(float(step_lengths(points).sum()), 1e-9)
    if RADIAN_RATIOS[0] < ratio < RADIAN_RATIOS[1]:
        raise TraceError(
            f"recorded speeds are {ratio:.0f} times what the positions need: if they are in "
            "radians, name their columns latitude_rad and longitude_rad"
        )


def _check_shape(read: DriveInPlane, keys: str) -> None:
    """Raise TraceError for points without extent or with steps of at least FAR."""
    table, points, numbers = read.table, read.points, read.table.source_numbers
    steps, count = step_lengths(points), len(numbers)
    if count == 1 and table.standing_points:
        radius = float(np.max(np.hypot(*(read.record_m - points))))
        all_points = f"{read.record_m.shape[1]} points within {radius:.2g} m"
        raise TraceError(f"the car stands all the time: {all_points}")
    if count == 1:
        raise TraceError(f"only one valid point, {table.source_unit} {numbers[0]}")
    extent = float(np.max(np.hypot(*(points - points[:, :1]))))
    if extent < LEAST_EXTENT:
        degrees = ". If x and y are degrees, name them longitude and latitude"
        fact = f"all {count} points lie within {extent:.2f} m, so there is no path"
        raise TraceError(fact + ("" if table.geodetic else degrees))
    long = np.flatnonzero(steps >= FAR)
    if not long.size:
        return
    fact = (
        f"{table.source_unit} {numbers[long[0] + 1]}: {steps[long[0]] / 1000:.1f} km from the "
        "point before"
    )
    if long.size > 1:
        fact += f", the first of {long.size} such steps"
    along = table.begin_m + distances_along(points)
    axis, unit = (recorded_times(table), "s") if table.time_s else (along, "m")
    runs = []
    for run in zip([0, *(long + 1).tolist()], [*long.tolist(), steps.size], strict=True):
        first, last = np.searchsorted(axis, bounds(*run, axis), side="left").tolist()
        if last - first >= MIN_POINTS - 1 and along[run[1]] - along[run[0]] >= LEAST_EXTENT:
            runs.append(run)
    if not runs:
        remedy = "hold together: check the coordinates"
        raise TraceError(f"{fact}: no {MIN_POINTS} points in succession {remedy}")
    parts = listed_parts(runs, axis, along, unit, keys)
    raise TraceError(f"{fact}: these parts hold together: {parts}")


# ---- The half width of the smoothing that the noise of points requires


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


def _needed_smoothing(points: Floats, noise: float, times: Floats) -> float:
    """Return the half width (m) that reduces noise to CURVATURE_NOISE; see `smooth_path`.

    A fast drive has wide bends only. There it also reduces noise to LATERAL_NOISE, up to half the
    smallest radius.
    """
    steps = step_lengths(points)
    moved = steps[steps > 0.0]
    spacing = max(float(np.median(moved)) if moved.size else 0.0, MERGED_NOISE * noise)
    kept = 20.0 * noise * math.sqrt(spacing)
    slow = 0.0  # speed (m/s) that a drive nearly always exceeds
    first = np.arange(np.searchsorted(times, times[-1:] - SPEED_SPAN_S).sum())
    if first.size:
        last = np.searchsorted(times, times[first] + SPEED_SPAN_S)
        speeds = np.hypot(*(points[:, last] - points[:, first])) / (times[last] - times[first])
        slow = float(np.quantile(speeds, SLOW_RATIO))
    fast = min(math.pow(kept * slow**2 / LATERAL_NOISE, 0.4), 0.5 * slow**2 / HARD_BEND)
    return min(float(math.ceil(max(math.pow(kept / CURVATURE_NOISE, 0.4), fast))), WIDEST)


# ---- Drives of a scenario


FAR_OUT = 10_000.0
"""Distance (m) from the origin beyond which coordinates are those of a map, such as UTM, and are
shifted to the origin. With an origin in the scenario it is the reach of the plane."""

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
    origin = Origin(**tables.origin.model_dump()) if tables.origin else None
    if isinstance(table, TracePath):
        try:
            read = read_trace(_file(table, folder), table, origin=origin, on_drive=on_drive)
        except TraceError as error:
            key = error.key if isinstance(error, PartError) else "path.file"
            raise SettingError(key, str(error)) from error
        origin, table = read.origin or origin, read.table
    if isinstance(table, PointsPath) and table.east_m and table.north_m:
        east, north = table.east_m[0], table.north_m[0]
        if math.hypot(east, north) > (REACH if tables.origin else FAR_OUT):
            table = _moved(table, float(round(east)), float(round(north)))
            east, north = table.east_offset_m, table.north_offset_m
            remark = (
                f"the coordinates begin {math.hypot(east, north) / 1000.0:.0f} km from their "
                f"origin: {east:.0f} m are subtracted from all eastings, {north:.0f} m from all "
                "northings"
            )
            table = table.model_copy(update={"remarks": (*table.remarks, remark)})
    placed = OriginTable()
    if origin is not None:
        place = origin.latitude_deg, origin.longitude_deg, origin.altitude_m
        placed = OriginTable(latitude_deg=place[0], longitude_deg=place[1], altitude_m=place[2])
    return tables.model_copy(update={"origin": placed, "path": table})


def at_recorded_speed(tables: ScenarioTables) -> ScenarioTables:
    """Set the recorded speed if the drive has times, unless another speed is configured."""
    table, speed = tables.path, tables.speed
    is_configured = speed.model_fields_set & {"lead", "set_mps", "profile"}
    if not isinstance(table, PointsPath) or not len(table.time_s) or table.closed or is_configured:
        return tables
    return tables.model_copy(update={"speed": speed.model_copy(update={"lead": "recorded"})})


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
    table = TracePath(
        kind="trace",
        file=own.replay or "",
        vehicle=own.replay_vehicle,
        topic=own.replay_topic,
        from_s=own.replay_from_s,
        to_s=own.replay_to_s,
    )
    try:
        path = _file(table, folder_of(key))
        read = read_trace(path, table, origin=origin, keys=f"{key}_", needs_times=True)
    except TraceError as error:
        at = error.key if isinstance(error, PartError) else key
        raise SettingError(at, str(error)) from error
    points = read.table
    if not isinstance(lead, PointsPath):
        return points
    if lead.source and lead.geodetic != points.geodetic:
        kinds = "latitudes" if lead.geodetic else "plane coordinates"
        raise SettingError(
            key, f"{table.file}: given in another plane, allowed {kinds} as {lead.source} has"
        )
    if not points.geodetic:
        points = _moved(points, lead.east_offset_m, lead.north_offset_m)
    apart = np.array((points.east_m, points.north_m)).T - (lead.east_m[0], lead.north_m[0])
    away = float(np.min(np.hypot(*apart.T)))
    if away > ELSEWHERE:
        raise SettingError(
            key,
            f"{table.file}: its closest point is {away / 1000.0:.1f} km from the start of the "
            f"lead's path, allowed at most {ELSEWHERE / 1000.0:g} km: is it the same road?",
        )
    return points


def _moved(table: PointsPath, east: float, north: float) -> PointsPath:
    return table.model_copy(
        update={
            "east_m": tuple(x - east for x in table.east_m),
            "north_m": tuple(y - north for y in table.north_m),
            "east_offset_m": table.east_offset_m + east,
            "north_offset_m": table.north_offset_m + north,
        }
    )


def _file(table: TracePath, folder: Path) -> Path:
    own, shipped = folder / table.file, TRACES / table.file
    return shipped if exists(shipped) and not exists(own) else own
