import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.examples import examples
from tests.made.scenarios.messages import truth
from tests.made.transport import drive
from vehicles.geometry.driven_path import CrossTrack, CrossTrackError
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.messages import TruePose

HEADINGS = [0.0, math.pi / 2, math.pi, -math.pi / 2]
STEP = 0.6  # between two poses at 30 m/s
RADIUS, AWAY = 12.0, math.acos(0.5 + 3.5 / (4 * 12.0))
SELF_MEETING = {
    "figure of eight that crosses itself": [
        Segment(40.0, 0.0),
        *[Segment(1.5 * math.pi * 20, 1 / 20), Segment(40.0, 0.0)],
        *[Segment(1.5 * math.pi * 20, -1 / 20), Segment(80.0, 0.0)],
        *[Segment(1.5 * math.pi * 20, 1 / 20), Segment(40.0, 0.0)],
    ],
    "three laps of a circle": [Segment(6 * math.pi * 20, 1 / 20)],
    "out, a bulb turn, and back 3.5 m apart": [
        Segment(60.0, 0.0),
        Segment(RADIUS * AWAY, -1 / RADIUS),
        Segment(RADIUS * (math.pi + 2 * AWAY), 1 / RADIUS),
        Segment(RADIUS * AWAY, -1 / RADIUS),
        Segment(60.0, 0.0),
    ],
}


def driven(
    path: SampledPath,
    stations: Iterable[float],
    offset: Callable[[float], float] = lambda _: 0.0,
    vehicle: str = "v1",
) -> list[TruePose]:
    """Poses at `stations` of `path`, offset to the left by `offset(station)` (m)."""
    poses = []
    for seq, station in enumerate(stations):
        point = path.at(station)
        left = offset(station)
        east = point.east - left * math.sin(point.yaw)
        north = point.north + left * math.cos(point.yaw)
        poses.append(truth(vehicle, seq, east, north, yaw=point.yaw))
    return poses


def every(step: float, start: float, end: float) -> list[float]:
    return [start + step * k for k in range(round((end - start) / step))]


def added(error: CrossTrackError, poses: Iterable[TruePose]) -> list[CrossTrack]:
    return [foot for pose in poses for foot in error.add(pose)]


def cross_track(
    own: Iterable[TruePose], lead: Iterable[TruePose], road_yaw: float | None = None
) -> list[CrossTrack]:
    """Foot points of a follower whose poses are added after the lead's whole path."""
    error = CrossTrackError("v1", road_yaw)
    assert added(error, lead) == []
    return added(error, (replace(pose, vehicle="v2") for pose in own))


def feet(path: SampledPath, stations: Sequence[float], offset: float) -> list[CrossTrack]:
    lead = driven(path, every(STEP, 0.0, path.length))
    return cross_track(driven(path, stations, lambda _: offset), lead)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("inwards", [2.0, -2.0])
def test_a_concentric_circle_has_the_difference_of_radii(turn: int, inwards: float) -> None:
    path = path_from_segments([Segment(300.0, turn / 100.0)])
    sagitta = STEP**2 / (8 * 100.0)
    result = feet(path, every(0.4, 0.0, 290.0), turn * inwards)
    assert len(result) == 725
    for foot, station in zip(result, every(0.4, 0.0, 290.0), strict=True):
        assert foot.lateral == pytest.approx(turn * inwards, abs=1.5 * sagitta)
        assert foot.station == pytest.approx(station, abs=0.02)


@pytest.mark.parametrize("name", SELF_MEETING)
@pytest.mark.parametrize("offset", [1.2, 0.0, -1.2])
def test_on_a_path_that_meets_itself_the_foot_stays_on_its_branch(name: str, offset: float) -> None:
    path = path_from_segments(SELF_MEETING[name])
    stations = every(0.3, -30.0, path.length - 2.0)
    result = feet(path, stations, offset)
    for foot, station in zip(result, stations, strict=True):
        assert foot.lateral == pytest.approx(offset, abs=0.01)
        assert foot.station == pytest.approx(station, abs=0.05)


@pytest.mark.parametrize("yaw", HEADINGS)
def test_with_a_known_road_yaw_the_lead_s_initial_yaw_does_not_matter(yaw: float) -> None:
    path = path_from_segments([Segment(100.0, 0.0)], yaw=yaw)
    lead = driven(path, every(STEP, 0.0, 99.0))
    lead[0] = replace(lead[0], yaw_rad=yaw + 0.6)
    own = driven(path, [-19.5, -10.0, -0.1, 0.1], lambda _: 0.5)
    result = cross_track(own, lead, road_yaw=yaw)
    assert [foot.station for foot in result] == pytest.approx([-19.5, -10.0, -0.1, 0.1])
    assert [foot.lateral for foot in result] == pytest.approx([0.5] * 4)
    assert max(foot.lateral for foot in cross_track(own, lead)) > 5.0


# ---- Single poses


LAPS = 2
TICKS = math.ceil(LAPS * 2 * math.pi * drive.RADIUS / drive.SPEED / (drive.TICK * 1e-9))


def test_inside_of_a_left_circle_is_left_of_the_path() -> None:
    """Two laps: a foot point on the second lap must not jump to the first."""
    error = CrossTrackError("v1")
    both = (drive.truth(name, tick) for tick in range(TICKS) for name in drive.VEHICLES)
    result = added(error, both)
    for place, vehicle in enumerate(drive.VEHICLES[1:], start=1):
        offsets = [foot.lateral for foot in result if foot.vehicle == vehicle]
        assert len(offsets) == TICKS
        chord = drive.SPEED * drive.TICK * 1e-9  # the path is a polygon: its sagitta is c²/8R
        assert offsets[150:] == pytest.approx(
            [drive.offset_of(place)] * (TICKS - 150), abs=chord**2 / (8 * drive.RADIUS)
        )


@pytest.mark.parametrize("heading", range(0, 360, 45))
def test_left_of_a_straight_is_positive_in_all_headings(heading: int) -> None:
    path = path_from_segments([Segment(60.0, 0.0)], yaw=math.radians(heading))
    error = CrossTrackError("v1")
    added(error, driven(path, every(1.0, 0.0, 30.0)))
    for vehicle, station, left in (("v2", -12.0, 0.3), ("v2", 7.5, 0.3), ("v3", 7.5, -0.2)):
        (foot,) = error.add(driven(path, [station], lambda _, left=left: left, vehicle)[0])  # type: ignore[misc]
        assert foot.vehicle == vehicle
        assert foot.station == pytest.approx(station)
        assert foot.lateral == pytest.approx(left)
    assert error.add(driven(path, [40.0], lambda _: -0.2, "v3")[0]) == []


def test_a_pose_beyond_the_end_of_the_path_waits_for_the_lead() -> None:
    path = path_from_segments([Segment(60.0, 0.0)])
    error = CrossTrackError("v1")
    first, second, third = driven(path, [4.5, 5.5, 5.0], lambda _: 0.3, "v2")
    assert added(error, driven(path, every(1.0, 0.0, 5.0))) == []
    assert [error.add(pose) for pose in (first, second, third)] == [[], [], []]
    result = [error.add(pose) for pose in driven(path, [5.0, 6.0, 7.0])]
    assert [[foot.station for foot in step] for step in result] == [[4.5], [5.5, 5.0], []]


COURSES = {
    **SELF_MEETING,
    "hairpin of 4 m radius": [
        Segment(50.0, 0.0), Segment(math.pi * 4.0, 1 / 4), Segment(50.0, 0.0),
    ],
    "left, right, straight": [
        Segment(30.0, 1 / 30), Segment(30.0, -1 / 30), Segment(30.0, 0.0),
    ],
}  # fmt: skip


def with_stop(stations: list[float], place: int, ticks: int) -> list[float]:
    return stations[:place] + [stations[place]] * ticks + stations[place:]


def interleaved(
    first: Sequence[TruePose], *others: Sequence[TruePose], seed: int
) -> list[TruePose]:
    """Interleave the poses of vehicles, keeping the order of each."""
    left = [list(poses) for poses in (first, *others)]
    random, mixed = Random(seed), []
    while any(left):
        # In blocks, so that a vehicle may be far ahead of another.
        poses = random.choice([poses for poses in left if poses])
        count = random.choice((1, 1, 5, 200))
        mixed += poses[:count]
        del poses[:count]
    return mixed


def projected(own: Sequence[TruePose], lead: Sequence[TruePose], yaw: float) -> list[float]:
    """Distances of `own` from the path, each the smallest near the previous foot point.

    At the corners of a polyline, half a metre apart on a radius of 4 m, 1 cm depends on the rule.
    """
    back = replace(
        lead[0],
        east_m=lead[0].east_m - 100.0 * math.cos(yaw),
        north_m=lead[0].north_m - 100.0 * math.sin(yaw),
    )
    corners, stations = [back], [-100.0]
    for pose in lead:
        step = math.hypot(pose.east_m - corners[-1].east_m, pose.north_m - corners[-1].north_m)
        if step > 0.01:
            corners.append(pose)
            stations.append(stations[-1] + step)
    result, here = [], -math.inf
    for pose in own:
        candidates = []
        for station, first, second in zip(stations, corners, corners[1:], strict=False):
            near = here - 3.0 < station < max(here, 0.0) + 3.0
            if not near and not (station == -100.0 and here < 3.0):
                continue
            east, north = second.east_m - first.east_m, second.north_m - first.north_m
            to_east, to_north = pose.east_m - first.east_m, pose.north_m - first.north_m
            square = east * east + north * north
            share = min(max((to_east * east + to_north * north) / square, 0.0), 1.0)
            away = math.hypot(to_east - share * east, to_north - share * north)
            side = math.copysign(1.0, east * to_north - north * to_east)
            candidates.append((away, side * away, station + share * math.sqrt(square)))
        _, lateral, here = min(candidates)
        result.append(lateral)
    return result


@given(
    course=st.sampled_from(sorted(COURSES)),
    offset=st.sampled_from([1.2, 0.4, 0.0, -0.7]),
    askew=st.sampled_from([None, 0.0, 0.5, -2.0]),
    stops=st.tuples(st.integers(5, 100), st.integers(5, 100), st.integers(0, 60)),
    seed=st.integers(0, 2**32),
)
@examples(8, 40)
def test_the_order_of_vehicles_does_not_change_the_foot_points(
    course: str, offset: float, askew: float | None, stops: tuple[int, int, int], seed: int
) -> None:
    path = path_from_segments(COURSES[course], 40.0, -7.0, 0.4)
    lead_stop, own_stop, ticks = stops
    lead = driven(path, with_stop(every(STEP, 0.0, path.length), lead_stop, ticks))
    if askew is not None:
        lead[0] = replace(lead[0], yaw_rad=0.4 + askew)
    road_yaw = None if askew is None else 0.4
    own = {
        "v2": driven(
            path, with_stop(every(0.55, -15.0, path.length - 2.0), own_stop, ticks),
            lambda _: offset, "v2",
        ),
        "v3": driven(path, every(0.6, -30.0, path.length - 17.0), swerving, "v3"),
    }  # fmt: skip
    mixed = added(CrossTrackError("v1", road_yaw), interleaved(lead, *own.values(), seed=seed))
    for vehicle, poses in own.items():
        batch = [foot._replace(vehicle=vehicle) for foot in cross_track(poses, lead, road_yaw)]
        assert [foot for foot in mixed if foot.vehicle == vehicle] == batch
        assert [foot.at_ns for foot in batch] == [pose.true_at_ns for pose in poses]
        assert [foot.lateral for foot in batch] == pytest.approx(
            projected(poses, lead, 0.4), abs=0.02
        )


# ---- Against geometry


def swerving(station: float) -> float:
    return 0.8 * math.sin(station / 13.0)


curves = st.lists(
    st.builds(Segment, st.floats(5.0, 40.0), st.floats(-0.04, 0.04)), min_size=1, max_size=5
)


@given(
    segments=curves,
    turn=st.floats(-math.pi, math.pi),
    east=st.floats(-1000.0, 1000.0),
    north=st.floats(-1000.0, 1000.0),
)
@settings(max_examples=30)
def test_rotation_and_translation_change_nothing(
    segments: list[Segment], turn: float, east: float, north: float
) -> None:
    here = path_from_segments(segments)
    there = path_from_segments(segments, east, north, turn)
    both = []
    for path in (here, there):
        lead = driven(path, every(STEP, 0.0, path.length))
        both.append(cross_track(driven(path, every(1.1, -20.0, path.length), swerving), lead))
    ones, others = ({foot.at_ns: foot for foot in feet} for feet in both)
    assert len(ones.keys() ^ others.keys()) <= 2  # those at both ends of the path
    together = [(ones[when], others[when]) for when in ones.keys() & others.keys()]
    # Outside a corner of the polyline a foot is on neither chord, and rounding decides which one
    # counts. They differ by the lateral distance times half the turn squared.
    tolerance = 0.8 * 0.5 * (0.04 * 2.0 * STEP) ** 2
    for first, second in together:
        assert first.lateral == pytest.approx(second.lateral, abs=tolerance)
        assert first.station == pytest.approx(second.station, abs=0.8 * 0.04 * 2.0 * STEP)
    exact = sum(abs(first.lateral - second.lateral) < 1e-8 for first, second in together)
    assert exact >= 0.9 * len(together)


@given(segments=curves)
@settings(max_examples=30)
def test_on_a_simple_path_it_is_the_distance_to_the_nearest_point(segments: list[Segment]) -> None:
    if sum(abs(s.curvature) * s.length for s in segments) > math.pi / 2:
        segments = [Segment(s.length, s.curvature * 0.2) for s in segments]
    path = path_from_segments([Segment(30.0, 0.0), *segments])
    lead_poses = driven(path, every(STEP, 0.0, path.length))
    own = driven(path, every(2.3, 5.0, path.length - 5.0), swerving)
    for foot, pose in zip(cross_track(own, lead_poses), own, strict=True):
        assert abs(foot.lateral) == pytest.approx(nearest(pose, lead_poses), abs=0.01)


def nearest(pose: TruePose, path: Sequence[TruePose]) -> float:
    """Distance to the polyline, by a hundred samples on each segment."""
    return min(
        math.hypot(
            first.east_m + share * (second.east_m - first.east_m) - pose.east_m,
            first.north_m + share * (second.north_m - first.north_m) - pose.north_m,
        )
        for first, second in pairwise(path)
        if math.hypot(first.east_m - pose.east_m, first.north_m - pose.north_m) < 5.0
        for share in (k / 100 for k in range(101))
    )
