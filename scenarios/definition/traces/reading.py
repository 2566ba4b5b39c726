"""A recorded drive: read from any format, checked, and projected into the plane."""

from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.cleaning import Cleaned, Stand, cleaned
from scenarios.definition.traces.formats.registry import read_recorded
from scenarios.definition.traces.positions import (
    FAR,
    Pause,
    PauseRule,
    are_vertices,
    between_vertices,
    pauses_in,
    usable_positions,
    without_pauses,
    without_repeats,
)
from scenarios.definition.traces.recorded_drive import (
    ALTITUDES_M,
    FASTEST,
    JUMP,
    NO_TIMES,
    Clock,
    DrivenPart,
    Floats,
    LeftOutRecords,
    Mask,
    RecordedDrive,
    TraceError,
    piece_between,
    pieces_in_words,
    points_within,
)
from scenarios.definition.traces.recorded_drive import MOST_BREAKS as MOST_LISTED
from scenarios.definition.traces.time_order import in_time_order
from vehicles.geometry.bridges import distances_along, noise_deviation, step_lengths
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.geometry.smoothing import MIN_POINTS

# ---- Recorded speeds of a drive that agree with its positions


WINDOW = 2.0
"""Time (s) over which positions give a speed."""

MOST_OFF = 10.0
"""Largest difference (m/s) of a recorded speed from its neighbours and from the positions..."""

MOST_OFF_SHARE = 0.5
"""...or this share of their speed, if that is more."""

LONGEST_RUN = 5.0
"""Longest time (s) of a single wrong value; longer ones are no slips."""

MOVING = 2.0
"""Speed (m/s) from which on the ratio of speeds counts."""

RATIOS = (0.8, 1.25)
"""Recorded speed over that of the positions; outside of it speeds are not in m/s."""

UNITS = {3.6: "km/h", 1.9438: "knots", 2.2369: "mph"}
"""Units by their number in 1 m/s."""

SAME_UNIT = 0.05
"""Largest relative difference of a ratio from that of its unit."""


def usable_speeds(
    speed_mps: Floats, time_s: Floats, points: Floats
) -> tuple[Floats | None, tuple[str, ...]]:
    """Return a speed (m/s) per point of `points` (2, n), None without usable ones, and remarks.

    `time_s` is empty if times are unknown. Points without a speed take that of the previous one.
    Single absurd speeds are interpolated.
    """
    known = np.flatnonzero(np.isfinite(speed_mps))
    if 2 * known.size <= points.shape[1]:
        return None, ()
    last = np.maximum(np.searchsorted(known, np.arange(points.shape[1]), side="right") - 1, 0)
    speeds = np.abs(speed_mps[known[last]])
    instead = "speeds follow from the times" if time_s.size else "speeds are ignored"
    if not speeds.any():
        return None, (f"every recorded speed is 0 while the position changes: {instead}",)
    derived = _derived(time_s, points) if time_s.size else np.full(speeds.size, np.nan)
    ratio = _median_ratio(speeds, derived)
    absurd = speeds > FASTEST
    if RATIOS[0] <= ratio <= RATIOS[1]:
        if 2 * np.count_nonzero(absurd) > speeds.size:
            return None, (f"most recorded speeds are above {FASTEST:g} m/s: {instead}",)
        absurd |= _slips(speeds, derived, time_s, absurd)
        at = time_s if time_s.size else np.arange(float(speeds.size))
        smooth = speeds.copy()
        smooth[absurd] = np.interp(at[absurd], at[~absurd], speeds[~absurd])
        ratio = _total_ratio(smooth, derived, time_s)
        if RATIOS[0] <= ratio <= RATIOS[1]:
            return smooth, _interpolated(absurd, speeds)
    unit = next((f" ({u}?)" for n, u in UNITS.items() if abs(ratio / n - 1.0) < SAME_UNIT), "")
    off = f"{ratio:.2f} times what the positions need{unit}"
    return None, (f"recorded speeds are {off}: {instead}",)


def _interpolated(absurd: Mask, speeds: Floats) -> tuple[str, ...]:
    count = int(np.count_nonzero(absurd))
    if not count:
        return ()
    worst = float(np.max(speeds[absurd]))
    if count == 1:
        return (f"1 recorded speed, {worst:.4g} m/s, does not fit the others: interpolated",)
    most = f"{count} recorded speeds, up to {worst:.4g} m/s, do not fit"
    return (f"{most} the others: interpolated",)


def _derived(at: Floats, points: Floats) -> Floats:
    """Return the speed (m/s) between points half a WINDOW before and after; NaN in silences."""
    k = np.arange(at.size)
    first = np.minimum(np.searchsorted(at, at - 0.5 * WINDOW), np.maximum(k - 1, 0))
    last = np.searchsorted(at, at + 0.5 * WINDOW, side="right") - 1
    last = np.maximum(last, np.minimum(k + 1, at.size - 1))
    span = at[last] - at[first]
    usual = float(np.median(np.diff(at))) if at.size > 1 else 0.0
    valid = (span > 0.0) & (span <= max(2.0 * WINDOW, 4.0 * usual))
    gone = np.hypot(*(points[:, last] - points[:, first]))
    return np.where(valid, gone / np.where(valid, span, 1.0), np.nan)


def _median_ratio(speeds: Floats, derived: Floats) -> float:
    """Return the median ratio of recorded speeds to those of the positions, 1 if unknown."""
    moving = derived >= MOVING
    if np.count_nonzero(moving) < 3:
        return 1.0
    return float(np.median(speeds[moving] / derived[moving]))


def _total_ratio(speeds: Floats, derived: Floats, at: Floats) -> float:
    """Return the ratio of distances by recorded speeds and by positions, 1 if unknown."""
    valid = np.isfinite(derived) & (derived < FASTEST)
    if np.count_nonzero(valid & (derived >= MOVING)) < 3:
        return 1.0
    gone = np.gradient(at)[valid]
    return float(np.sum(gone * speeds[valid]) / np.sum(gone * derived[valid]))


def _slips(speeds: Floats, derived: Floats, at: Floats, absurd: Mask) -> Mask:
    """Mark short runs of speeds that fit neither the positions nor the speeds around the run."""
    off = absurd | _differs(speeds, derived)
    edges = np.diff(np.concatenate(([False], off, [False])).astype(np.int8))
    begin, end = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    if off.all() or not begin.size or not at.size:
        return absurd
    short = at[end] - at[begin] <= LONGEST_RUN
    marks = np.zeros(off.size + 1, dtype=np.int64)
    np.add.at(marks, begin[short], 1)
    np.add.at(marks, end[short] + 1, -1)
    in_short = np.cumsum(marks)[:-1] > 0
    around = np.interp(at, at[~off], speeds[~off])
    return np.asarray(in_short & _differs(speeds, around))


def _differs(speeds: Floats, others: Floats) -> Mask:
    limit = np.maximum(MOST_OFF, MOST_OFF_SHARE * others)
    return np.asarray(np.abs(speeds - others) > limit)  # False for NaN


# ---- Reading


LEAST_EXTENT = 1.0
"""Smallest extent (m) of a path."""

Ints = NDArray[np.int64]

NO_VALUES = np.zeros(0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveInPlane:
    """A recorded drive in the east-north plane of `origin` (None: the file has plane coordinates).

    Arrays of one value per point, except where stated. `time_s` (from the first point on,
    nondecreasing) and `speed_mps` are empty unless the file has them. `source_numbers` are the
    places of the points in the file, counted in `source_unit`s. Times count from `epoch_s` on the
    `clock`, or without one on that of the file.

    The points are a part of the drive, which begins `begin_s` and `begin_m` after its first point.
    `pauses` are those of the part; with `pauses_cut` the times do without them.
    `record_count` points were recorded, at `record_m` (2, n): all with a usable place. `left_out`
    lists the others, and jumps.
    """

    source: str
    format_name: str
    clock: Clock | None
    epoch_s: float
    source_unit: str
    source_numbers: Ints
    noise_m: float
    skipped_lines: int
    jumping_points: int
    standing_points: int
    remarks: tuple[str, ...]
    origin: Origin | None = None
    east_m: Floats
    north_m: Floats
    time_s: Floats
    speed_mps: Floats
    begin_s: float = 0.0
    begin_m: float = 0.0
    pauses: tuple[Pause, ...] = ()
    pauses_cut: bool = False
    left_out: LeftOutRecords = field(default_factory=LeftOutRecords)
    left_out_lines: tuple[str, ...] = ()
    record_m: Floats
    record_count: int


OnDrive = Callable[[DriveInPlane], None]


def read_trace(
    path: Path,
    *,
    origin: Origin | None = None,
    vehicle: str | None = None,
    topic: str | None = None,
    part: DrivenPart | None = None,
    pauses: PauseRule = "keep",
    needs_times: bool = False,
    on_drive: OnDrive = lambda _: None,
) -> DriveInPlane:
    """Read the recorded drive at `path` into the plane of `origin`, by default its first point.

    Name and content of the file determine the format. `vehicle` selects one of a log, `topic` the
    positions of another MCAP file. Unusable records are left out and listed. Raises TraceError with
    a line that starts with the file, also for a drive without times if it `needs_times`; `on_drive`
    receives also a drive that has no path.
    """
    part = part or DrivenPart()
    try:
        drive = usable_positions(read_recorded(path, vehicle=vehicle, topic=topic))
        drive, time_error_s = without_repeats(_ordered(drive, needs_times=needs_times))
        plane = origin or _first_point(drive) if drive.geodetic else None
        points = _in_plane(drive, plane) if plane else drive.position
        clean = cleaned(points, _times(drive), time_error_s)
        _list_jumps(drive, clean)
        trace = _driven(path.name, replace(drive, position=points), clean, part)
        recorded = trace = replace(trace, origin=plane)
        if pauses == "cut":
            times = without_pauses(trace.time_s, trace.pauses)
            trace = replace(trace, time_s=times, pauses_cut=True)
        on_drive(trace)
        _check_shape(recorded, part.keys)
    except TraceError as error:
        error.args = (f"{path}: {error}",)
        raise
    return trace


def _ordered(drive: RecordedDrive, *, needs_times: bool) -> RecordedDrive:
    ordered = in_time_order(drive)
    if needs_times and not _times(ordered).size:
        reasons = [f", {text}" for text in ordered.remarks if text.endswith(NO_TIMES)]
        raise TraceError("given without times, allowed only with them" + "".join(reasons[:1]))
    return ordered


def _times(drive: RecordedDrive) -> Floats:
    """Return the times (s) of all points, or of none."""
    return NO_VALUES if bool(np.isnan(drive.time_s).any()) else drive.time_s


def _driven(source: str, drive: RecordedDrive, clean: Cleaned, part: DrivenPart) -> DriveInPlane:
    """Put the kept points of `part` together; positions of `drive` are in the plane (m)."""
    times, kept = _times(drive), np.asarray(clean.kept)
    jumping = sum(jump.last - jump.first + 1 for jump in clean.jumps)
    since_start = times[kept] - times[kept[0]] if times.size else NO_VALUES
    along = distances_along(clean.points)
    zero = float(times[kept[0]]) if times.size else 0.0
    chosen = points_within(part, since_start, along)
    speeds, about_speeds = _speeds(drive, times, clean)
    kept, points = kept[chosen], clean.points[:, chosen]
    is_drawn = not times.size and are_vertices(points)
    noise_m = clean.noise if part.is_whole else _noise(clean, kept, points)
    if is_drawn:
        about_line = f"a smooth line through {kept.size} points without times, far apart"
        points, before = between_vertices(points)
        kept, noise_m, about_speeds = kept[before], 0.0, (*about_speeds, about_line)
    since_part = since_start[chosen] - since_start[chosen][:1]
    pauses = pauses_in(points, since_part)
    paused = {int(kept[pause.point]) for pause in pauses}
    remarks = _stand_remarks(clean.stands, drive, times - zero, paused)
    return DriveInPlane(
        source=source,
        format_name=drive.format_name,
        clock=drive.clock if times.size else None,
        epoch_s=drive.zero_s + float(times[kept[0]]) if times.size else 0.0,
        source_unit=drive.unit,
        source_numbers=drive.numbers[kept],
        noise_m=noise_m,
        skipped_lines=drive.left_out.total - jumping,
        jumping_points=jumping,
        standing_points=sum(stand.last - stand.first + 1 for stand in clean.stands),
        remarks=(*drive.remarks, *remarks, *about_speeds),
        east_m=points[0],
        north_m=points[1],
        time_s=since_part,
        speed_mps=NO_VALUES if speeds is None else _speeds_at(kept, speeds, clean),
        begin_s=float(since_start[chosen][0]) if times.size else 0.0,
        begin_m=float(along[chosen][0]),
        pauses=pauses,
        left_out=drive.left_out,
        left_out_lines=drive.left_out.lines(drive.unit, zero),
        record_m=drive.position,
        record_count=drive.count,
    )


def _speeds(
    drive: RecordedDrive, times: Floats, clean: Cleaned
) -> tuple[Floats | None, tuple[str, ...]]:
    """Return a usable speed per point, NaN at jumps, None without any, and remarks."""
    sound = np.ones(drive.count, dtype=bool)
    for jump in clean.jumps:
        sound[jump.first : jump.last + 1] = False
    at = times[sound] if times.size else times
    speeds, remarks = usable_speeds(drive.speed_mps[sound], at, drive.position[:, sound])
    if speeds is None:
        return None, remarks
    column = np.full(drive.count, np.nan)
    column[sound] = speeds
    return column, remarks


def _speeds_at(kept: Ints, speeds: Floats, clean: Cleaned) -> Floats:
    """Return the speeds of kept points, 0 at standstill."""
    still = [k for stand in clean.stands for k in stand.core]
    return np.where(np.isin(kept, still), 0.0, speeds[kept])


def _noise(clean: Cleaned, kept: Ints, points: Floats) -> float:
    """Return the noise (m) of a part: of its points, and of the standstills in it."""
    within = [s.wander for s in clean.stands if kept[0] <= s.core[0] and s.core[1] <= kept[-1]]
    return max([noise_deviation(points), *within])


def _list_jumps(drive: RecordedDrive, clean: Cleaned) -> None:
    for jump in clean.jumps:
        for k in range(jump.first, jump.last + 1):
            drive.list_fault(k, JUMP, f"jumps by {jump.size:.1f} m")


def _stand_remarks(
    stands: Iterable[Stand], drive: RecordedDrive, times: Floats, paused: Container[int]
) -> Iterator[str]:
    """Describe standstills, except pauses, after `paused` points; `times` (s) are of all points."""

    def where(k: int) -> str:
        place = f"{drive.unit} {drive.numbers[k]}"
        return f"{place} ({times[k]:.1f} s)" if times.size else place

    for stand in stands:
        first, last = stand.core
        span = f" for {times[last] - times[first]:.0f} s" if times.size else ""
        count = stand.last - stand.first + 1
        if stand.first == 0:
            begin = where(last)
            yield f"the drive starts at its first movement, at {begin}: {count} points left out"
        elif stand.last == drive.count - 1:
            yield f"the drive ends where it stops, at {where(first)}: {count} points left out"
        elif first not in paused:
            yield f"the car stands{span} from {where(first)} on: {count} points become one place"


def _first_point(drive: RecordedDrive) -> Origin:
    latitude, longitude = drive.position[:, 0].tolist()
    least, most = ALTITUDES_M
    usable = drive.altitude_m[(drive.altitude_m >= least) & (drive.altitude_m <= most)]
    altitude = float(usable[0]) if usable.size else 0.0
    if not abs(latitude) <= 89.0:
        place = f"{drive.unit} {drive.numbers[0]}"
        raise TraceError(f"{place}: latitude {latitude:g} deg, allowed -89 to 89")
    return Origin(latitude, (longitude + 180.0) % 360.0 - 180.0, altitude)


def _in_plane(drive: RecordedDrive, origin: Origin) -> Floats:
    """Project points into the plane at the origin's height, to ignore noise in height."""
    plane = LocalPlane(origin)
    points = plane.to_plane_all(drive.position[0], drive.position[1], origin.altitude_m)
    beyond = np.flatnonzero(np.isnan(points[0]))
    if beyond.size:
        k = int(beyond[0])
        latitude, longitude = drive.position[:, k].tolist()
        try:
            plane.to_plane(latitude, longitude, origin.altitude_m)
        except ValueError as error:
            raise TraceError(f"{drive.unit} {drive.numbers[k]}: {error}") from error
    return points


def _check_shape(trace: DriveInPlane, keys: str) -> None:
    points = np.array((trace.east_m, trace.north_m))
    numbers = trace.source_numbers
    if numbers.size == 1:
        raise TraceError(_one_point(trace))
    steps = step_lengths(points)
    if (steps >= FAR).any():
        raise TraceError(_apart(trace, steps, keys))
    extent = float(np.max(np.hypot(*(points - points[:, :1]))))
    if extent < LEAST_EXTENT:
        raise TraceError(
            f"all {numbers.size} points lie within {extent:.2f} m, so there is no path"
        )


def _one_point(trace: DriveInPlane) -> str:
    if not trace.standing_points:
        return f"only one valid point, {trace.source_unit} {trace.source_numbers[0]}"
    place = np.array(((trace.east_m[0],), (trace.north_m[0],)))
    radius = float(np.max(np.hypot(*(trace.record_m - place))))
    return f"the car stands all the time: {trace.record_count} points within {radius:.2g} m"


def _apart(trace: DriveInPlane, steps: Floats, keys: str) -> str:
    """Explain `steps` of at least FAR, and name the largest parts without any."""
    long = np.flatnonzero(steps >= FAR)
    place = f"{trace.source_unit} {trace.source_numbers[long[0] + 1]}"
    fact = f"{place}: {steps[long[0]] / 1000:.1f} km from the point before"
    if long.size > 1:
        fact += f", the first of {long.size} such steps"
    along = trace.begin_m + np.concatenate((np.zeros(1), np.cumsum(steps)))
    axis, unit = (trace.begin_s + trace.time_s, "s") if trace.time_s.size else (along, "m")
    begins, ends = np.append(0, long + 1), np.append(long, steps.size)
    usable = (ends - begins >= MIN_POINTS - 1) & (along[ends] - along[begins] >= LEAST_EXTENT)
    begins, ends = begins[usable], ends[usable]
    largest = np.argsort(begins - ends, kind="stable")[:MOST_LISTED]
    pieces = [piece_between(int(begins[k]), int(ends[k]), axis, along) for k in largest]
    pieces = [piece for piece in pieces if piece.last > piece.first]
    if not pieces:
        return f"{fact}: no {MIN_POINTS} points in succession hold together: check the coordinates"
    words = pieces_in_words(pieces, begins.size, unit, keys, steps.size)
    return f"{fact}: these parts hold together: {words}"
