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
    """Return the time (s) in the record at which the run starts, and whether clocks are common.

    Files without absolute times count from the same instant.
    """
    lead, later = tables.path, own.replay_offset_s + route.run_in
    if not isinstance(lead, PointsPath) or tables.speed.lead != "recorded":
        return -later, False
    if (lead.clock is None) == (drive.clock is None):
        apart = drive.epoch_s - lead.epoch_s
        if "day" in {lead.clock, drive.clock}:  # no date: use the nearer of two days
            apart = math.remainder(apart, DAY)
        if -drive.time_s[-1] < apart < lead.time_s[-1]:
            return -apart - later, True
    return -later, False


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
    key, lead, longest = f"vehicle.{name}.replay", tables.path, longest_run(route)
    if tables.duration_s is None and duration < longest and drive.lasts < duration + 0.1:
        yield (
            f"{name}: its recorded drive ends {duration:g} s after the start, which ends the run "
            f"before the lead's drive of {longest:g} s. Set duration_s or trim the files."
        )
    if drive.common and isinstance(lead, PointsPath) and lead.pauses == "cut" and lead.pause_points:
        first = lead.time_s[lead.pause_points[0]]
        yield (
            f"{name}: the lead's pauses are cut, {sum(lead.pause_lost_s):.1f} s in total, those of "
            f"the replayed drive are kept: from {first:.1f} s of the lead's drive on they are at "
            f'different times of the recordings. Set path.pauses = "keep", or end the drive before '
            "its first pause with path.to_s."
        )
    at, stations, offsets = _along_lead(drive, route, duration)
    leads = route.start + np.array([route.profile.distance(t) for t in at.tolist()])
    k = int(np.argmax(np.abs(offsets)))
    if abs(offsets[k]) > FAR_OFF:
        yield (
            f"{name}: the replayed drive is {abs(offsets[k]):.1f} m off the lead's path at "
            f"{at[k]:.1f} s: is it on the same road?"
        )
    behind_lead = leads - stations
    k = int(np.argmin(behind_lead))
    if behind_lead[k] < LEAST_SPACING:
        side = "ahead of" if behind_lead[k] < 0.0 else "behind"
        yield (
            f"{name}: the replayed drive is {abs(behind_lead[k]):.1f} m {side} the lead at "
            f"{at[k]:.1f} s: they overlap. Raise {key}_offset_s."
        )
    names = tables.convoy.vehicle_names
    behind = dict(pairwise(names)).get(name, "")
    own = tables.vehicle.get(behind)
    if not behind or (own is not None and own.replay is not None):
        return
    place = names.index(behind)
    # Followers that keep a gap follow it anyway.
    compared = slice(None) if tables.speed.followers == "same" else slice(1)
    left = route.start - route.start_station(place) - behind_lead[compared]
    k = int(np.argmin(left))
    if left[k] < LEAST_SPACING:
        wider = math.ceil(route.gaps[place] + route.spacings[place] - left[k])
        yield (
            f"{name}: the replayed drive is {abs(left[k]):.1f} m "
            f"{'ahead of' if left[k] > 0.0 else 'behind'} {behind}, its follower, at {at[k]:.1f} "
            f"s: they overlap. Set vehicle.{behind}.gap_m to {wider}, or change {key}_offset_s."
        )


def _along_lead(
    drive: ReplayedDrive, route: Route, duration: float
) -> tuple[Floats, Floats, Floats]:
    """Return times (s) of a run, and station and offset (m, left positive) on the lead's path."""
    step = max(LOOK, duration / MOST_LOOKS)
    times = step * np.arange(int(duration / step) + 1, dtype=np.float64)
    near, before, feet = None, 0.0, []
    for at in times.tolist():
        point, _, gone = drive.at(at)
        near = None if near is None else near + gone - before
        foot = route.path.project(point.east, point.north, near, window=NEAR)
        near, before = foot.station, gone
        feet.append((foot.station, foot.lateral))
    stations, offsets = np.array(feet).T
    return times, stations, offsets
