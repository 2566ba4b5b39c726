"""A vehicle that moves as it was recorded: along its own smoothed places, by its recorded times."""

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.road.route import Route, check_span, longest_run, smoothed_points
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.schema.scenario_tables import ScenarioTables, VehicleTable
from vehicles.geometry.local_regression import NEIGHBOURS, local_cubic
from vehicles.geometry.path_point import PathPoint
from vehicles.geometry.smoothing import SmoothedPath

STEP = 0.2
"""Time step (s) between the knots of a recorded motion."""

LEAST_INTERVAL = 0.01
"""Stands and holes are filled with points that are no closer than this (s)."""

REACH = 1.0
"""Recorded stations are smoothed over this time (s) to either side..."""

REACH_PER_METRE = 2.0
"""...and over this time (s) for each metre of noise, if that is more."""

DAY = 86_400.0

OVERTIME = 1.0
"""So long (s) after the end of its record a vehicle goes on as it was going."""

LOOK = 0.5
"""Time step (s) at which a replayed vehicle is compared with its neighbours."""

NEAR = 50.0
"""It is looked for on the lead's path within this way (m) of where it is expected."""

LEAST_SPACING = 5.0
"""Neighbours whose centres are planned closer than this (m) touch each other."""

RUN_IN = 50.0
"""The straight before a replayed drive's first point (m)."""

BESIDE = 5.0
"""A drive that is further than this (m) from the lead's path is another road."""


@dataclass(frozen=True, slots=True)
class ReplayedDrive:
    """The motion of a replayed vehicle over the time of a run.

    Knots of `times` (s, of its record, from its first point), `stations` (m) and `speeds` (m/s) on
    its `road`. At the start of the run `begun` s of the record have passed, by a `common` clock, or
    else counted from where the lead's drive begins; where that is negative it comes up to its first
    point on a straight.
    """

    road: SmoothedPath
    times: tuple[float, ...]
    stations: tuple[float, ...]
    speeds: tuple[float, ...]
    begun: float
    common: bool

    @property
    def lasts(self) -> float:
        """Time (s) after the start of the run at which its record ends."""
        return self.times[-1] - self.begun

    def at(self, seconds: float) -> tuple[PathPoint, float, float]:
        """Place, speed (m/s) and way from its first point (m) `seconds` s after the start."""
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
        """Station and speed on the cubic (Hermite) from knot k to the next."""
        step = self.times[k + 1] - self.times[k]
        u = (time - self.times[k]) / step
        way = self.stations[k + 1] - self.stations[k]
        v0, v1 = self.speeds[k] * step, self.speeds[k + 1] * step
        square, cube = 3.0 * way - 2.0 * v0 - v1, v0 + v1 - 2.0 * way
        slope = v0 + u * (2.0 * square + 3.0 * u * cube)
        return self.stations[k] + u * (v0 + u * (square + u * cube)), max(slope / step, 0.0)


def plan_replay(tables: ScenarioTables, name: str, route: Route) -> ReplayedDrive:
    """Lay out the motion of vehicle `name`, which is replayed; raises Refused."""
    own = tables.vehicle[name]
    drive, key = own.drive, f"vehicle.{name}.replay"
    if drive is None:
        raise SettingError(key, "has not been read")
    if not drive.time_s:
        raise SettingError(key, f"{drive.source}: given without times, allowed only with them")
    check_span(f"{key} ({drive.source})", drive)
    try:
        road = smoothed_points(drive, RUN_IN)
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
    """Times, stations and speeds: smoothed over time, never backwards."""
    given = np.asarray(drive.time_s[: road.points_used])
    kept = np.flatnonzero(np.diff(given, prepend=-math.inf) > 0.0)
    t, s = given[kept] - given[0], np.maximum.accumulate(road.stations[kept])
    if t.size < NEIGHBOURS:
        return None
    # Stands and holes are long steps in time, over which a cubic would swing: filled evenly.
    usual = max(float(np.median(np.diff(t))), LEAST_INTERVAL)
    even = np.linspace(0.0, t[-1], max(math.ceil(t[-1] / usual), t.size) + 1)
    times = np.linspace(0.0, t[-1], max(math.ceil(t[-1] / STEP), 1) + 1)
    reach = max(REACH, REACH_PER_METRE * road.noise)
    stations = local_cubic(even, np.interp(even, t, s)[None, :], times, reach)[0]
    # A cubic swings over the beginning and the end of a stand by some centimetres.
    stations = np.maximum.accumulate(np.clip(stations, s[0], s[-1]))
    means = np.diff(stations) / np.diff(times)
    slower = np.minimum(np.append(means, math.inf), np.append(math.inf, means))
    # Up to three times the slower mean beside a knot a cubic never goes backwards (Fritsch and
    # Carlson, 1980).
    speeds = np.minimum(np.gradient(stations, times), 3.0 * slower)
    return tuple(times.tolist()), tuple(stations.tolist()), tuple(speeds.tolist())


def _begun(
    tables: ScenarioTables, own: VehicleTable, drive: PointsPath, route: Route
) -> tuple[float, bool]:
    """How much of the record (s) is over when the run starts, and whether by a common clock."""
    lead = tables.path
    later = own.replay_offset_s + route.run_in
    if isinstance(lead, PointsPath) and tables.speed.lead == "recorded":
        apart = _apart(lead, drive)
        if apart is not None and -drive.time_s[-1] < apart < lead.time_s[-1]:
            return -apart - later, True
    return -later, False


def _apart(lead: PointsPath, drive: PointsPath) -> float | None:
    """How much later (s) than the lead's a drive begins; None where only one has absolute times.

    Where none has, both files are taken to count from one instant.
    """
    if (lead.clock is None) != (drive.clock is None):
        return None
    apart = drive.epoch_s - lead.epoch_s
    # Times of day say nothing of the date: the nearer of two days is meant.
    return math.remainder(apart, DAY) if "day" in {lead.clock, drive.clock} else apart


def whole_run(route: Route, drives: Iterable[ReplayedDrive]) -> float:
    """Time (s) until the lead reaches the end of its path, or a replayed one that of its record."""
    longest = longest_run(route)
    ends = min((drive.lasts for drive in drives if drive.lasts > 0.0), default=math.inf)
    return longest if ends + OVERTIME >= longest else math.floor(10.0 * ends) / 10.0


def replay_problems(
    tables: ScenarioTables, name: str, drive: ReplayedDrive, duration: float
) -> Iterator[tuple[str, str]]:
    """Give what keeps a replayed vehicle from taking part: a record that ends before the run."""
    if drive.lasts + OVERTIME < duration:
        source = tables.vehicle[name].replay
        allowed = f"set duration_s to at most {max(drive.lasts, 0.0):.1f}"
        if drive.lasts <= 0.0:
            allowed = "do both begin at about the same time? see replay_offset_s"
        yield (
            f"vehicle.{name}.replay",
            f"{source} ends {drive.lasts:.1f} s after the start, the run lasts {duration:g} s: "
            f"{allowed}",
        )


def replay_warnings(
    tables: ScenarioTables, name: str, drive: ReplayedDrive, route: Route, duration: float
) -> Iterator[str]:
    """Say where a replayed vehicle is not on the lead's path between its neighbours.

    And whether the run ends with it, since no duration is given.
    """
    longest = longest_run(route)
    if tables.duration_s is None and duration < longest and drive.lasts < duration + 0.1:
        yield (
            f"{name}: its recorded drive ends {duration:g} s after the start, which ends the run "
            f"before the lead's drive of {longest:g} s. Set duration_s or trim the files."
        )
    names = tables.convoy.vehicle_names
    behind = dict(pairwise(names)).get(name, "")
    seen = list(_looks(drive, route, duration))
    aside = max(seen, key=lambda look: look.aside)
    if aside.aside > BESIDE:
        yield (
            f"{name}: the replayed drive is {aside.aside:.1f} m beside the lead's path at "
            f"{aside.at:.1f} s: is it of the same road?"
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
    # Followers that keep a gap come after it wherever it is.
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


@dataclass(frozen=True, slots=True)
class _Look:
    """Where a replayed vehicle is `at` s after the start, and the lead as planned.

    Stations (m) on the lead's path, and how far the vehicle is `aside` of it (m).
    """

    at: float
    station: float
    lead: float
    aside: float


def _looks(drive: ReplayedDrive, route: Route, duration: float) -> Iterator[_Look]:
    near: float | None = None
    for k in range(int(duration / LOOK) + 1):
        point, speed, _ = drive.at(k * LOOK)
        foot = route.path.project(point.east, point.north, near, window=NEAR)
        near = foot.station + speed * LOOK
        lead = route.start + route.profile.distance(k * LOOK)
        yield _Look(k * LOOK, foot.station, lead, abs(foot.lateral))
