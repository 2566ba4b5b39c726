"""The motion of a replayed vehicle: along its smoothed path, by its recorded times."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.road.lead_speed import LONG_SILENCE, RECORDED_STEP
from scenarios.definition.road.point_path import check_span, smoothed_points
from scenarios.definition.road.route import Route, longest_run
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.schema.scenario_tables import ScenarioTables, VehicleTable
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.sampled_path import FloatArray as Floats
from vehicles.geometry.sampled_path import PathPoint
from vehicles.geometry.smoothing import NEIGHBOURS, SmoothedPath, local_cubic

LEAST_INTERVAL = 0.01
"""Smallest interval (s) of points that fill standstills and holes."""

REACH = 1.0
"""Smoothing of recorded stations: smallest reach (s) to either side."""

REACH_PER_METRE = 2.0
"""Smoothing of recorded stations: reach (s) per metre of noise."""

DAY = 86_400.0

OVERTIME = 1.0
"""Time (s) for which a vehicle continues after the end of its record."""

LOOK, MOST_LOOKS = 0.5, 20_000
"""Time step (s) at which a replayed vehicle is compared with its neighbours, and the largest number
of comparisons, above which the step is longer."""

NEAR = 50.0
"""Distance (m) from its expected station within which it is projected onto the lead's path."""

LEAST_SPACING = 5.0
"""Neighbours whose centres are planned closer than this (m) touch each other."""

RUN_IN = 50.0
"""The straight before a replayed drive's first point (m)."""

FAR_OFF = 5.0
"""Distance (m) from the lead's path above which a warning is due."""


@dataclass(frozen=True, slots=True)
class ReplayedDrive:
    """The motion of a replayed vehicle during a run.

    `times` (s) of the record count from its first point; `stations` (m) and `speeds` (m/s) are on
    its `road`. The run starts `begun` s after the first point, by a `common` clock or else by the
    start of the lead's drive. If that is negative, the vehicle reaches its first point on a
    straight.
    """

    road: SmoothedPath
    times: tuple[float, ...]
    stations: tuple[float, ...]
    speeds: tuple[float, ...]
    begun: float
    common: bool

    @property
    def lasts(self) -> float:
        """Time (s) after the start of the run when the record ends."""
        return self.times[-1] - self.begun

    def at(self, seconds: float) -> tuple[PathPoint, float, float]:
        """Return point, speed (m/s) and distance (m) from the first point at a time of the run."""
        time = self.begun + seconds
        k = min(max(bisect_right(self.times, time) - 1, -1), len(self.times) - 1)
        if k < 0 or k == len(self.times) - 1:
            end = max(k, 0)
            speed = self.speeds[end]
            station = self.stations[end] + speed * (time - self.times[end])
        else:
            station, speed = self._between(k, time)
        return self.road.path.at(station), speed, station - self.stations[0]

    def _between(self, k: int, time: float) -> tuple[float, float]:
        """Return station and speed on the cubic (Hermite) from knot k to the next."""
        step = self.times[k + 1] - self.times[k]
        u = (time - self.times[k]) / step
        length = self.stations[k + 1] - self.stations[k]
        v0, v1 = self.speeds[k] * step, self.speeds[k + 1] * step
        square, cube = 3.0 * length - 2.0 * v0 - v1, v0 + v1 - 2.0 * length
        slope = v0 + u * (2.0 * square + 3.0 * u * cube)
        return self.stations[k] + u * (v0 + u * (square + u * cube)), max(slope / step, 0.0)


def plan_replay(tables: ScenarioTables, name: str, route: Route) -> ReplayedDrive:
    """Plan the motion of a replayed vehicle; raises SettingError."""
    own = tables.vehicle[name]
    drive, key = own.drive, f"vehicle.{name}.replay"
    if drive is None:
        raise SettingError(key, "has not been read")
    if not drive.time_s:
        raise SettingError(key, f"{drive.source}: given without times, allowed only with them")
    check_span(f"{key} ({drive.source})", drive, f"{key}_")
    try:
        road = smoothed_points(drive, RUN_IN, f"{key}_")
    except SettingError as error:
        raise SettingError(key, f"{drive.source}: {error.why}") from error
    knots = _knots(drive, road)
    if knots is None:
        raise SettingError(
            key, f"{drive.source}: fewer than {NEIGHBOURS} points with times of their own"
        )
    begun, common = _begun(tables, own, drive, route)
    return ReplayedDrive(road, *knots, begun, common)


def _knots(
    drive: PointsPath, road: SmoothedPath
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]] | None:
    """Return times, stations and speeds, smoothed over time and never backwards."""
    given = np.asarray(drive.time_s[: road.points_used])
    kept = np.flatnonzero(np.diff(given, prepend=-math.inf) > 0.0)
    t, s = given[kept] - given[0], np.maximum.accumulate(road.stations[kept])
    if t.size < NEIGHBOURS:
        return None
    lost_t, lost_s, cuts = _lost_in_pauses(t, s)
    t, s = t - np.append(0.0, lost_t), s - np.append(0.0, lost_s)
    # A cubic would overshoot over standstills and holes, which are long steps: fill them evenly.
    usual = max(float(np.median(np.diff(t))), LEAST_INTERVAL)
    even = np.linspace(0.0, t[-1], max(math.ceil(t[-1] / usual), t.size) + 1)
    times = np.linspace(0.0, t[-1], max(math.ceil(t[-1] / RECORDED_STEP), 1) + 1)
    reach = max(REACH, REACH_PER_METRE * road.noise)
    stations = local_cubic(even, np.interp(even, t, s)[None, :], times, reach)[0]
    # A cubic overshoots by some centimetres at both ends of a standstill.
    stations = np.maximum.accumulate(np.clip(stations, s[0], s[-1]))
    passed = np.searchsorted(cuts, times)
    times, stations = (
        times + np.append(0.0, lost_t)[passed],
        stations + np.append(0.0, lost_s)[passed],
    )
    means = np.diff(stations) / np.diff(times)
    slower = np.minimum(np.append(means, math.inf), np.append(math.inf, means))
    # A cubic is monotone up to three times the slower mean next to a knot (Fritsch and Carlson,
    # 1980).
    speeds = np.minimum(np.gradient(stations, times), 3.0 * slower)
    return tuple(times.tolist()), tuple(stations.tolist()), tuple(speeds.tolist())


def _lost_in_pauses(t: Floats, s: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the time (s) and distance (m) lost up to each interval, and the instants of the cuts.

    Of an interval longer than LONG_SILENCE its middle is cut out before smoothing, so that knots
    are only where the speed changes. Instants (s) are those without the lost times.
    """
    gone = np.diff(t)
    share = np.maximum(gone - LONG_SILENCE, 0.0) / gone
    lost_t, lost_s = np.cumsum(share * gone), np.cumsum(share * np.diff(s))
    return lost_t, lost_s, t[1:] - lost_t - np.where(share > 0.0, 0.5 * LONG_SILENCE, 0.0)


def _begun(
    tables: ScenarioTables, own: VehicleTable, drive: PointsPath, route: Route
) -> tuple[float, bool]:
    """Return the time (s) in the record at which the run starts, and whether clocks are common."""
    lead = tables.path
    later = own.replay_offset_s + route.run_in
    if isinstance(lead, PointsPath) and tables.speed.lead == "recorded":
        apart = _apart(lead, drive)
        if apart is not None and -drive.time_s[-1] < apart < lead.time_s[-1]:
            return -apart - later, True
    return -later, False


def _apart(lead: PointsPath, drive: PointsPath) -> float | None:
    """Return the start (s) of a drive after the lead's; None if only one has absolute times.

    Without absolute times both files count from the same instant.
    """
    if (lead.clock is None) != (drive.clock is None):
        return None
    apart = drive.epoch_s - lead.epoch_s
    # Times of day have no date: use the nearer of two days.
    return math.remainder(apart, DAY) if "day" in {lead.clock, drive.clock} else apart


def whole_run(route: Route, drives: Iterable[ReplayedDrive]) -> float:
    """Return the time (s) until the lead's path ends, or the record of a replayed vehicle."""
    longest = longest_run(route)
    ends = min((drive.lasts for drive in drives if drive.lasts > 0.0), default=math.inf)
    return longest if ends + OVERTIME >= longest else math.floor(10.0 * ends) / 10.0


def replay_problems(
    tables: ScenarioTables, name: str, drive: ReplayedDrive, duration: float
) -> Iterator[tuple[str, str]]:
    """Yield a problem if the record ends before the run."""
    if drive.lasts + OVERTIME < duration:
        source = tables.vehicle[name].replay
        allowed = f"set duration_s to at most {max(drive.lasts, 0.0):.1f}"
        if drive.lasts <= 0.0:
            allowed = "do both start at about the same time? See replay_offset_s"
        yield (
            f"vehicle.{name}.replay",
            f"{source} ends {drive.lasts:.1f} s after the start, the run lasts {duration:g} s: "
            f"{allowed}",
        )


def replay_warnings(
    tables: ScenarioTables, name: str, drive: ReplayedDrive, route: Route, duration: float
) -> Iterator[str]:
    """Warn of a replayed vehicle off the lead's path, in a neighbour, or that ends the run."""
    longest = longest_run(route)
    if tables.duration_s is None and duration < longest and drive.lasts < duration + 0.1:
        yield (
            f"{name}: its recorded drive ends {duration:g} s after the start, which ends the run "
            f"before the lead's drive of {longest:g} s. Set duration_s or trim the files."
        )
    yield from _clock_warnings(tables, name, drive)
    names = tables.convoy.vehicle_names
    behind = dict(pairwise(names)).get(name, "")
    seen = list(_looks(drive, route, duration))
    farthest = max(seen, key=lambda look: abs(look.offset))
    if abs(farthest.offset) > FAR_OFF:
        yield (
            f"{name}: the replayed drive is {abs(farthest.offset):.1f} m off the lead's path at "
            f"{farthest.at:.1f} s: is it on the same road?"
        )
    early = max(seen, key=lambda look: look.station - look.lead)
    if early.lead - early.station < LEAST_SPACING:
        by = f"{abs(early.lead - early.station):.1f} m"
        side = "ahead of" if early.station > early.lead else "behind"
        where = f"{by} {side} the lead at {early.at:.1f} s"
        yield (
            f"{name}: the replayed drive is {where}: they overlap. Raise "
            f"vehicle.{name}.replay_offset_s."
        )
    own = tables.vehicle.get(behind)
    if not behind or (own is not None and own.replay is not None):
        return
    # Followers that keep a gap follow it anyway.
    compared = seen if tables.speed.followers == "same" else seen[:1]
    place = names.index(behind)
    distance = route.start - route.start_station(place)
    late = min(compared, key=lambda look: look.station - look.lead)
    left = late.station - (late.lead - distance)
    if left < LEAST_SPACING:
        where = f"{abs(left):.1f} m {'ahead of' if left > 0.0 else 'behind'} {behind}"
        wider = route.gaps[place] + route.spacings[place] - left
        yield (
            f"{name}: the replayed drive is {where}, its follower, at {late.at:.1f} s: they "
            f"overlap. Set vehicle.{behind}.gap_m to {math.ceil(wider)}, or change "
            f"vehicle.{name}.replay_offset_s."
        )


def _clock_warnings(tables: ScenarioTables, name: str, drive: ReplayedDrive) -> Iterator[str]:
    lead = tables.path
    if not drive.common or not isinstance(lead, PointsPath) or lead.pauses != "cut":
        return
    if lead.pause_points:
        first = lead.time_s[lead.pause_points[0]]
        yield (
            f"{name}: the lead's pauses are cut, {sum(lead.pause_lost_s):.1f} s in total, those of "
            f"the replayed drive are kept: from {first:.1f} s of the lead's drive on they are at "
            f'different times of the recordings. Set path.pauses = "keep", or end the drive before '
            "its first pause with path.to_s."
        )


@dataclass(frozen=True, slots=True)
class _Look:
    """Stations (m) of a replayed vehicle and of the lead on its path, `at` s after the start.

    `offset` (m) is the distance of the vehicle from the path, left positive.
    """

    at: float
    station: float
    lead: float
    offset: float


def _looks(drive: ReplayedDrive, route: Route, duration: float) -> Iterator[_Look]:
    step = max(LOOK, duration / MOST_LOOKS)
    times = step * np.arange(int(duration / step) + 1, dtype=np.float64)
    leads = route.start + _distances(route.profile, times)
    near: float | None = None
    before = 0.0
    for at, lead in zip(times.tolist(), leads.tolist(), strict=True):
        point, _, gone = drive.at(at)
        near = None if near is None else near + gone - before
        foot = route.path.project(point.east, point.north, near, window=NEAR)
        near, before = foot.station, gone
        yield _Look(at, foot.station, lead, foot.lateral)


def _distances(profile: SpeedProfile, times: Floats) -> Floats:
    """Distances (m) driven from time 0 to each of `times` (s), as `SpeedProfile.distance`."""
    knots = np.array([0.0, *(time for time in profile.times if time > 0.0)])
    speeds = np.interp(knots, profile.times, profile.speeds)
    driven = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(knots)))
    last = np.searchsorted(knots, times, side="right") - 1
    here = np.interp(times, profile.times, profile.speeds)
    return np.asarray(driven[last] + 0.5 * (speeds[last] + here) * (times - knots[last]))
