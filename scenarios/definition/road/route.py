"""The lead's path and speed, and the start of each vehicle."""

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.road.lead_speed import Limits, SpeedPlan, recorded, slowed, with_changes
from scenarios.definition.road.point_path import LONGEST, check_length, check_span, smoothed_points
from scenarios.definition.schema.path_tables import (
    PathTable,
    PointsPath,
    SegmentsPath,
    SegmentTable,
)
from scenarios.definition.schema.scenario_tables import ScenarioTables, SpeedTable
from scenarios.definition.traces.drive import NO_TIMES
from scenarios.definition.vehicle_setup import VehicleSetup, empty_car
from transport.links.link import keyed_draw
from vehicles.car.parameters import least_spacing
from vehicles.driver.controller import SpacingPolicy
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.geodesy import yaw_from_heading
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.geometry.smoothing import SmoothedPath

# ---- Gaps between bumpers, as configured, and spacings between centres of mass, as kept
#
# A car reaches as far beyond its front axle as beyond its rear one.


DEFAULT_GAP = 10.0
"""Gap (m) at the start where the scenario gives none: a third of a second at 30 m/s."""


def least_spacings(tables: ScenarioTables) -> tuple[float, ...]:
    """Spacing (m) to the predecessor at which the bumpers touch; 0 for the lead."""
    cars = [empty_car(tables, name) for name in tables.convoy.vehicle_names]
    return (0.0, *(least_spacing(ahead, behind) for ahead, behind in pairwise(cars)))


def spacing_policy(tables: ScenarioTables, least: float) -> SpacingPolicy:
    """Return the policy of `[speed.gap]` for a pair whose bumpers touch at the spacing `least`."""
    gap = tables.speed.gap
    return SpacingPolicy(gap.standstill_m + least, gap.headway_s)


def source_policies(tables: ScenarioTables, setup: VehicleSetup) -> dict[str, SpacingPolicy]:
    """Spacing of a follower to each longitudinal source, negative to those behind."""
    names, least = tables.convoy.vehicle_names, least_spacings(tables)
    kept = [spacing_policy(tables, spacing) for spacing in least]
    return {
        name: summed_spacing(kept, names.index(name), setup.place)
        for name in setup.flow.longitudinal
    }


def summed_spacing(kept: Sequence[SpacingPolicy], place: int, own: int) -> SpacingPolicy:
    """Sum the spacings `kept` by place from `own` to another `place`, negative to one behind."""
    between = kept[max(place, own) : min(place, own) : -1]
    sign = 1.0 if place < own else -1.0
    return SpacingPolicy(
        sign * sum([policy.standstill for policy in between]),
        sign * sum([policy.headway for policy in between]),
    )


def gaps_at(tables: ScenarioTables, speed: float) -> tuple[float, ...]:
    """Gaps (m) to the predecessor at the start, at `speed` (m/s); 0 for the lead."""
    return _distances(tables, speed, [0.0] * len(tables.convoy.vehicle_names))


def spacings_at(tables: ScenarioTables, speed: float) -> tuple[float, ...]:
    """Spacings (m) to the predecessor at the start, at `speed` (m/s); 0 for the lead."""
    return _distances(tables, speed, least_spacings(tables))


def _distances(tables: ScenarioTables, speed: float, least: Sequence[float]) -> tuple[float, ...]:
    """Sum `least` and the gap of each follower: its own, the convoy's, the kept or the default."""
    kept = tables.speed.followers == "gap"
    usual = tables.convoy.gap_m
    if usual is None and not kept:
        usual = DEFAULT_GAP
    distances = [0.0]
    for name, touching in zip(tables.convoy.vehicle_names[1:], least[1:], strict=True):
        own = tables.vehicle.get(name)
        gap = usual if own is None or own.gap_m is None else own.gap_m
        policy = spacing_policy(tables, touching)
        distances.append(policy.desired(speed) if gap is None else gap + touching)
    return tuple(distances)


# ---- Route


RUN_UP = 10.0
"""Length (m) of the straight behind the last vehicle."""

KNOTS_PER_PERIOD = 64
"""Points per period of an oscillating speed: their chords lie within 0.12 % of the amplitude."""
STRAIGHT = 1e-6
"""Curvature (1/m) below which a path counts as straight."""

CLOSED = 1.0
"""A closed path of segments ends within this distance (m) of its beginning."""

SAME_DIRECTION = 0.99
"""Cosine of the largest angle between both ends of a closed path: 8 degrees."""

SLOW = 5.0
"""Initial speed (m/s) below which a recorded drive starts at its first point, after a straight that
does not bend into the drive. At such speeds the step causes no error."""

SPEED_RATIOS = (0.8, 1.25)
"""Distance by recorded speeds over the path's length; outside of it they are not in m/s."""


@dataclass(frozen=True, kw_only=True)
class Route:
    """A drivable path, the station at which the lead starts, and the lead's speed over time.

    `start` (m) is that station: the path begins with a straight for the vehicles behind the lead.
    `gaps` (m) are the initial gaps to the predecessor, bumper to bumper, `spacings` (m) those
    between centres of mass; both are 0 for the lead. `profile` is the lead's speed from the start
    on, with all changes, `plan` without. `smoothed` is None for segments. `speed_ratio` is the
    factor by which recorded speeds were scaled to cover the path. The lead reaches the first point
    of a recorded drive `run_in` s after the start. `lap` (m) is the length of a lap of a closed
    path, 0 of any other.
    """

    path: SampledPath
    start: float
    gaps: tuple[float, ...]
    spacings: tuple[float, ...]
    profile: SpeedProfile
    smoothed: SmoothedPath | None
    speed_ratio: float
    plan: SpeedPlan
    run_in: float = 0.0
    lap: float = 0.0

    def start_station(self, place: int) -> float:
        """Station (m) on the path at which the vehicle at `place` (0 is the lead) starts."""
        return self.start - sum(self.spacings[: place + 1])

    @property
    def first_point(self) -> float:
        """Station (m) of the first segment, or of the first recorded point."""
        return self.smoothed.start if self.smoothed else self.start

    @property
    def start_yaw(self) -> float:
        """Direction (rad) of the path where the lead starts."""
        return self.path.at(self.start).yaw

    @property
    def length(self) -> float:
        """Distance (m) from the lead's start to the end of the path."""
        return self.path.length - self.start


def vehicle_names(tables: ScenarioTables) -> tuple[str, ...]:
    return tables.convoy.vehicle_names


def plan_route(tables: ScenarioTables) -> Route:
    """Plan path and speed of a scenario whose trace has been read; raises SettingError."""
    if tables.speed.lead == "recorded" and isinstance(tables.path, PointsPath):
        key = f"path ({tables.path.source})" if tables.path.source else "path.time_s"
        check_span(key, tables.path)
    fastest = _first_speed_at_most(tables)
    lead_in = sum(spacings_at(tables, fastest)) + RUN_UP
    path, start, smoothed = _path(tables, lead_in)
    if tables.speed.lead == "recorded":
        wanted, start, ratio = _recorded(tables, start, smoothed)
        profile = wanted
        if smoothed is not None and start == smoothed.start:
            path = _straight_before(path, start)
    else:
        wanted, ratio = _wanted(tables, tables.duration_s or 0.0), 1.0
        until = tables.duration_s or LONGEST
        profile = slowed(wanted, path, start, _limits(tables.speed), until)
    first_speed = profile.at(0.0)[0]
    plan = SpeedPlan(
        path=path,
        start=start,
        limits=_limits(tables.speed),
        until=tables.duration_s or LONGEST,
        wanted=wanted,
        profile=profile,
    )
    return Route(
        path=path,
        start=start,
        gaps=gaps_at(tables, first_speed),
        spacings=spacings_at(tables, first_speed),
        profile=with_changes(plan, tables.change).profile,
        smoothed=smoothed,
        speed_ratio=ratio,
        plan=plan,
        run_in=profile.time_to(smoothed.start - start) if smoothed else 0.0,
        lap=_lap(tables.path, smoothed),
    )


def is_closed(table: PathTable) -> bool:
    """Whether the path returns to its beginning: `closed` points, or segments that do so."""
    return _segments_lap(table) > 0.0 if isinstance(table, SegmentsPath) else table.closed


def _lap(table: PathTable, smoothed: SmoothedPath | None) -> float:
    if isinstance(table, SegmentsPath):
        return _segments_lap(table)
    return smoothed.lap_length if smoothed and table.closed else 0.0


def _segments_lap(table: SegmentsPath) -> float:
    """Length (m) after which repeated segments first end where they began; 0 if they never do."""
    once, turned = 0j, 0.0
    for segment in table.segments:
        angle = segment.length_m * curvature(segment)
        chord = segment.length_m * (math.sin(0.5 * angle) / (0.5 * angle) if angle else 1.0)
        once += cmath.rect(chord, turned + 0.5 * angle)
        turned += angle
    end = 0j
    for count in range(1, table.laps + 1):
        end += once * cmath.exp(1j * (count - 1) * turned)
        if abs(end) < CLOSED and math.cos(count * turned) > SAME_DIRECTION:
            return count * sum(segment.length_m for segment in table.segments)
    return 0.0


def _first_speed_at_most(tables: ScenarioTables) -> float:
    speed = tables.speed
    if speed.lead == "profile":
        return speed.profile[0].speed_mps
    if speed.lead == "recorded" and isinstance(tables.path, PointsPath):
        return max(tables.path.speed_mps, default=speed.set_mps)
    return speed.set_mps


def _path(tables: ScenarioTables, lead_in: float) -> tuple[SampledPath, float, SmoothedPath | None]:
    """Return the path, with a straight of at least `lead_in` m before the start of the lead."""
    table = tables.path
    if isinstance(table, SegmentsPath):
        yaw = yaw_from_heading(table.heading_deg)
        check_length(table, sum(segment.length_m for segment in table.segments))
        laps = [Segment(s.length_m, curvature(s)) for s in table.segments] * table.laps
        east, north = -lead_in * math.cos(yaw), -lead_in * math.sin(yaw)
        return _along((Segment(lead_in, 0.0), *laps), east, north, yaw), lead_in, None
    if not isinstance(table, PointsPath):
        raise SettingError("path.file", "has not been read")
    smoothed = smoothed_points(table, lead_in)
    # Smoothing bends the end of the straight. The lead starts before that, so that all vehicles
    # start without errors.
    curved = np.flatnonzero(np.abs(smoothed.path.curvature) > STRAIGHT)
    first_curve = float(smoothed.path.station[curved[0]]) if curved.size else math.inf
    return smoothed.path, min(max(first_curve, lead_in), smoothed.start), smoothed


@lru_cache(maxsize=4)  # runs of a study share a road
def _along(segments: tuple[Segment, ...], east: float, north: float, yaw: float) -> SampledPath:
    return path_from_segments(segments, east, north, yaw)


def _straight_before(path: SampledPath, start: float) -> SampledPath:
    """Replace a path before station `start` (m) by its tangent there."""
    first = path.at(start)
    before = path.station < start - 1e-9
    before_start = start - path.station
    return SampledPath(
        path.station.copy(),
        np.where(before, first.east - before_start * math.cos(first.yaw), path.east),
        np.where(before, first.north - before_start * math.sin(first.yaw), path.north),
        np.where(before, first.yaw, path.yaw),
        np.where(before, 0.0, path.curvature),
    )


def curvature(segment: SegmentTable) -> float:
    """Return the curvature (1/m, left positive) of a segment."""
    if segment.radius_m is not None:
        return (1.0 if segment.turn == "left" else -1.0) / segment.radius_m
    return segment.curvature_per_m or 0.0


def _wanted(tables: ScenarioTables, duration: float) -> SpeedProfile:
    """Return the configured speed over `duration` (s), before it is lowered in curves."""
    table = tables.speed
    if table.lead == "oscillating":
        return _oscillating(table, duration)
    if table.lead != "profile":
        return SpeedProfile((0.0,), (table.set_mps,))
    delay = table.profile_delay_s_max
    if delay:
        delay *= keyed_draw(tables.seed, "speed", "")("profile_delay_s_max", 0)
    times = tuple(point.at_s + delay for point in table.profile)
    return SpeedProfile(times, tuple(point.speed_mps for point in table.profile))


def _oscillating(table: SpeedTable, duration: float) -> SpeedProfile:
    oscillation = table.oscillation
    step = 1.0 / (KNOTS_PER_PERIOD * oscillation.frequency_hz)
    count = max(math.ceil((duration - oscillation.from_s) / step), 0) + 1
    phase = 2.0 * math.pi * np.arange(count) / KNOTS_PER_PERIOD
    speeds = table.set_mps + oscillation.amplitude_mps * np.sin(phase)
    times = oscillation.from_s + step * np.arange(count)
    return SpeedProfile(tuple(times.tolist()), tuple(np.maximum(speeds, 0.0).tolist()))


def _limits(table: SpeedTable) -> Limits:
    return Limits(
        lateral=table.lateral_acceleration_mps2_max,
        acceleration=table.acceleration_mps2_max,
        braking=table.braking_mps2_max,
    )


def _recorded(
    tables: ScenarioTables, start: float, smoothed: SmoothedPath | None
) -> tuple[SpeedProfile, float, float]:
    """Return the speed from the start on, the station (m) of the start, and the scaling factor."""
    table = tables.path
    if not isinstance(table, PointsPath) or smoothed is None or not table.time_s:
        raise SettingError("speed.lead", _why_untimed(table))
    if table.closed:
        raise SettingError("speed.lead", 'given "recorded", allowed only with path.closed = false')
    stations = smoothed.stations.tolist()
    noise = smoothed.noise
    profile, ratio = recorded(table.time_s, stations, table.speed_mps, noise)
    if table.source and not SPEED_RATIOS[0] <= ratio <= SPEED_RATIOS[1]:
        # They fit the points when the file was read, but not the smoothed path.
        profile, ratio = recorded(table.time_s, stations, (), noise)
    if not SPEED_RATIOS[0] <= ratio <= SPEED_RATIOS[1]:
        times = f"{1.0 / ratio:.2f} times" if ratio > 0.0 else "not"
        raise SettingError(
            f"path ({table.source})", f"recorded speeds are {times} what its points need: m/s?"
        )
    first, run_in = profile.speeds[0], smoothed.start - start
    if first < SLOW or run_in <= 0.0:
        return profile, smoothed.start, ratio
    knots = (0.0, *(run_in / first + time for time in profile.times))
    return SpeedProfile(knots, (first, *profile.speeds)), start, ratio


def _why_untimed(table: PathTable) -> str:
    because = ""
    if isinstance(table, PointsPath) and table.source:
        reasons = [remark for remark in table.remarks if remark.endswith(NO_TIMES)]
        because = f", {table.source} has none{f' ({reasons[0]})' if reasons else ''}"
    remedy = 'use speed.lead = "set" with speed.set_mps'
    return f'given "recorded", allowed only for a path with times{because}: {remedy}'


def longest_run(route: Route) -> float:
    """Return the time (s) until the lead reaches the end of its path, rounded down to 0.1 s."""
    return math.floor(10.0 * min(route.profile.time_to(route.length), LONGEST) + 1e-6) / 10.0
