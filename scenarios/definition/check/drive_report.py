"""`convoy check` of a recorded drive: facts of the recording, and of the path through it."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Literal

import numpy as np

from scenarios.definition.road.point_path import place_of
from scenarios.definition.road.replayed_drive import replay_warnings
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.path_tables import PointsPath, SmoothedPathTable
from scenarios.definition.traces.drive import JUMP, PATH_KEYS, WRONG_TIME
from scenarios.definition.traces.reading import DriveInPlane
from vehicles.geometry.bridges import distances_along, find_holes, step_lengths
from vehicles.geometry.sampled_path import FloatArray
from vehicles.geometry.smoothing import Hole, SmoothedPath

SPEED_WINDOW = 1.0
"""Half width (s) of the window for speeds that follow from recorded times."""

STRAIGHT = 1e-6
"""Curvature (1/m) below which a path has no radius."""

SpeedSource = Literal["recorded", "derived"]
"""Speeds as recorded, or derived from the recorded times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HoleFacts:
    """A hole of `length_m`, `after` a place in the file, `at_m` of the drive."""

    after: str
    at_m: float
    length_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PauseFacts:
    """A pause of `lasts_s`, `after` a place in the file, `at_m` of the drive.

    With `path.pauses = "cut"` it `is_cut`: the lead loses no time.
    """

    after: str
    at_m: float
    lasts_s: float
    is_cut: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PathFacts:
    """The path of a convoy along a drive.

    `radius_m_min` is `at_m` of the drive, None on a straight road, and `turning_radius_m` that of
    the car that needs most. `bend_speed_mps_max` is the speed in the tightest bend at
    speed.lateral_acceleration_mps2_max. `smoothing_m` is the half width of the smoothing;
    deviations are those of the path from the recorded points.
    """

    radius_m_min: float | None
    at_m: float | None
    turning_radius_m: float
    bend_speed_mps_max: float | None
    smoothing_m: float
    deviation_m_rms: float
    deviation_m_max: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveReport:
    """Facts of a recorded drive.

    `records` were read, `points` of them are driven; `left_out` counts records left out, and
    those with a wrong time, by their kind; `left_out_first` lists the first. `begins_at` is in UTC
    (ISO 8601, or the time of day only), None without absolute times. `noise_m` is the standard
    deviation of the points per axis.
    The drive is a part of the recording, `from_s` and `from_m` after its start, 0 for the whole.
    The mean speed is without pauses. `remarks` state assumptions and changes. `path` is None if the
    drive cannot be driven.
    """

    file: str
    format: str
    records: int
    points: int
    begins_at: str | None
    from_s: float
    from_m: float
    duration_s: float | None
    rate_hz: float | None
    length_m: float
    noise_m: float
    speed_source: SpeedSource | None
    speed_mps_min: float | None
    speed_mps_mean: float | None
    speed_mps_max: float | None
    holes: tuple[HoleFacts, ...]
    pauses: tuple[PauseFacts, ...]
    left_out: dict[str, int]
    left_out_first: tuple[str, ...]
    remarks: tuple[str, ...]
    path: PathFacts | None


def drive_report(drive: DriveInPlane, scenario: Scenario | None) -> DriveReport:
    """Report on a drive, and on its path in a `scenario`, None if it cannot be driven."""
    table, counts = drive.table, drive.left_out.counts
    road = scenario.route.smoothed if scenario is not None else None
    along, steps = driven_m(drive, scenario), step_lengths(drive.points)
    speeds, source = speeds_mps(drive, along)
    moving = table.time_s[-1] if table.time_s else 0.0
    moving -= 0.0 if table.pauses == "cut" else sum(table.pause_lost_s)
    holes = road.holes if road else [Hole(int(k), float(steps[k])) for k in find_holes(steps)]
    unread = sum(count for kind, count in counts.items() if kind not in (JUMP, WRONG_TIME))
    pauses = zip(table.pause_points, table.pause_lasts_s, strict=True)
    return DriveReport(
        file=Path(table.source).name,
        format=drive.format_name,
        records=drive.record_m.shape[1] + unread,
        points=len(set(table.source_numbers)),
        begins_at=_begin(table),
        from_s=table.begin_s,
        from_m=table.begin_m,
        duration_s=table.time_s[-1] if table.time_s else None,
        rate_hz=_rate(np.array(table.time_s)),
        length_m=float(along[-1]),
        noise_m=road.noise if road else table.noise_m,
        speed_source=source,
        speed_mps_min=float(np.min(speeds)) if source else None,
        speed_mps_mean=float(along[-1]) / moving if source and moving > 0.0 else None,
        speed_mps_max=float(np.max(speeds)) if source else None,
        holes=tuple(
            HoleFacts(
                after=place_of(table, hole.point),
                at_m=float(along[hole.point]),
                length_m=hole.length,
            )
            for hole in holes
        ),
        pauses=tuple(
            PauseFacts(
                after=place_of(table, point),
                at_m=float(along[min(point, len(along) - 1)]),
                lasts_s=lasts,
                is_cut=table.pauses == "cut",
            )
            for point, lasts in pauses
        ),
        left_out=dict(counts),
        left_out_first=table.left_out,
        remarks=table.remarks,
        path=_path(scenario, road) if scenario is not None and road is not None else None,
    )


def driven_m(drive: DriveInPlane, scenario: Scenario | None) -> FloatArray:
    """Return the distance (m) of each point along the drive: on its path if it has one."""
    if scenario is not None and (road := scenario.route.smoothed) is not None:
        return road.stations - road.start
    return distances_along(drive.points)


def speeds_mps(drive: DriveInPlane, along: FloatArray) -> tuple[FloatArray, SpeedSource | None]:
    """Return the speeds at points at distances `along` (m), empty without speeds and times."""
    if drive.table.speed_mps:
        return np.array(drive.table.speed_mps[: len(along)]), "recorded"
    times = np.array(drive.table.time_s[: len(along)])
    if not times.size or drive.table.time_s[-1] <= 0.0:
        return np.zeros(0), None
    late = np.minimum(times + SPEED_WINDOW, times[-1])
    early = np.maximum(times - SPEED_WINDOW, times[0])
    gone = np.interp(late, times, along) - np.interp(early, times, along)
    return np.asarray(gone / (late - early)), "derived"


def _begin(table: PointsPath) -> str | None:
    if table.clock is None or not table.time_s:
        return None
    begin = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=table.epoch_s)
    text = begin.isoformat(timespec="milliseconds").removesuffix("+00:00") + "Z"
    return text if table.clock == "unix" else text.partition("T")[2]


def _rate(times: FloatArray) -> float | None:
    steps = np.diff(times)
    steps = steps[steps > 0.0]
    return 1.0 / float(np.median(steps)) if steps.size else None


def _path(scenario: Scenario, road: SmoothedPath) -> PathFacts:
    route = scenario.route
    on_drive = np.flatnonzero(route.path.station >= road.start)
    sharpest = int(on_drive[np.argmax(np.abs(route.path.curvature[on_drive]))])
    curvature = abs(float(route.path.curvature[sharpest]))
    radius = 1.0 / curvature if curvature > STRAIGHT else None
    cars = [scenario.vehicle(name).parameters for name in scenario.vehicle_names]
    lateral = scenario.tables.speed.lateral_acceleration_mps2_max
    return PathFacts(
        radius_m_min=radius,
        at_m=float(route.path.station[sharpest]) - road.start if radius else None,
        turning_radius_m=max(car.wheelbase / car.steering_limit for car in cars),
        bend_speed_mps_max=math.sqrt(lateral * radius) if radius else None,
        smoothing_m=road.half_width,
        deviation_m_rms=road.deviation_rms,
        deviation_m_max=road.deviation_max,
    )


# ---- Warnings of recorded drives: changes while reading, smoothing, holes, replayed vehicles


CUT_RATIO = 0.5
"""Half width of an automatic smoothing, in smallest radii, above which a warning is due."""

FAR_FROM_POINTS = 0.5
"""Distance (m) between path and recorded points above which a warning is due."""

LISTED_MAX = 5
"""Number of holes, and of pauses, in a drive with their own warning."""

USUAL_SMOOTHING = SmoothedPathTable().smoothing_m
"""Half width (m) of the smoothing unless the noise of the points requires more."""


def drive_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn of what is left out, assumed or inaccurate in the recorded drives of a scenario."""
    tables, table, smoothed = scenario.tables, scenario.tables.path, scenario.route.smoothed
    if isinstance(table, PointsPath) and smoothed is not None:
        yield from recording_warnings(table, smoothed)
        yield from _width_warnings(table, smoothed, PATH_KEYS)
        is_set = tables.speed.model_fields_set & {"set_mps", "profile"}
        if table.source and not table.time_s and not is_set:
            speed = f"the lead drives {tables.speed.set_mps:g} m/s"
            yield f"{table.source}: the drive has no times, {speed}. Set speed.set_mps."
        if smoothed.deviation_max > FAR_FROM_POINTS:
            yield (
                f"the path lies up to {smoothed.deviation_max:.1f} m from the recorded points "
                f"(rms {smoothed.deviation_rms:.2f} m, noise of the points {smoothed.noise:.2f} "
                f"m): curves are cut. Lower path.smoothing_m = {smoothed.half_width:g}, unless the "
                "points are noisy."
            )
    for name, drive in scenario.replays.items():
        if (own := tables.vehicle[name].drive) is not None:
            yield from recording_warnings(own, drive.road, f"vehicle.{name}.replay_")
            yield from _width_warnings(own, drive.road, f"vehicle.{name}.replay_")
        yield from replay_warnings(tables, name, drive, scenario.route, scenario.duration_s)


def recording_warnings(
    table: PointsPath, smoothed: SmoothedPath, keys: str = PATH_KEYS
) -> Iterator[str]:
    """Warn of faults of a recording, which a DriveReport lists as well."""
    source = table.source or "path"
    if count := table.skipped_lines + table.jumping_points:
        records = "1 record is" if count == 1 else f"{count} records are"
        yield f"{source}: {records} left out or corrected: {'; '.join(table.left_out)}"
    yield from (f"{source}: {remark}" for remark in table.remarks)
    result = "the vehicle waits there"
    if keys == PATH_KEYS:
        result = 'the lead waits there, path.pauses = "cut" leaves the time out'
        if table.pauses == "cut":
            result = 'the time is left out, path.pauses = "keep" waits there'
    pauses = list(zip(table.pause_points, table.pause_lasts_s, strict=True))
    for point, lasts in pauses[:LISTED_MAX]:
        yield f"{source}: a pause of {lasts:.1f} s after {place_of(table, point)}: {result}"
    if rest := [lasts for _, lasts in pauses[LISTED_MAX:]]:
        yield f"{source}: {len(rest)} more pauses, {sum(rest):.0f} s in total"
    for point, length in smoothed.holes[:LISTED_MAX]:
        yield (
            f"{source}: a hole of {length:.1f} m after {place_of(table, point)} is bridged by a "
            "smooth curve: the road there is a guess"
        )
    if lengths := [hole.length for hole in smoothed.holes[LISTED_MAX:]]:
        yield f"{source}: {len(lengths)} more holes, up to {max(lengths):.1f} m long"


def _width_warnings(table: PointsPath, smoothed: SmoothedPath, keys: str) -> Iterator[str]:
    """Warn of an automatic half width that cuts curves, or that removes too little noise."""
    source, used, is_lead = table.source or "path", smoothed.half_width, keys == PATH_KEYS
    sharpest = float(np.max(np.abs(smoothed.path.curvature)))
    if used < table.smoothing_m:
        yield (
            f"{source}: the path is smoothed over a half width of {used:g} m, because a car cannot "
            f"drive the tight turns at the {table.smoothing_m:g} m for noise of "
            f"{smoothed.noise:.2g} m: the {'lead' if is_lead else 'vehicle'} steers after noise, "
            f"the smallest radius is {1.0 / sharpest:.1f} m. "
            f"{'Set path.smoothing_m, or leave' if is_lead else 'Leave'} the turns out with "
            f"{keys}from_s and {keys}to_s."
        )
    elif table.narrower_m and used > USUAL_SMOOTHING and used * sharpest > CUT_RATIO:
        yield (
            f"{source}: the points scatter by {table.noise_m:.2g} m, so the half width of the "
            f"smoothing is {used:g} m instead of {USUAL_SMOOTHING:g}: bends with a smaller radius "
            "are cut" + (". Set path.smoothing_m to change it" if is_lead else "")
        )
