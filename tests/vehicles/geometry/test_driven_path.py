import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.messages import at, truth
from vehicles.geometry.driven_path import CrossTrack, DrivenPath, cross_track
from vehicles.geometry.path import Path, Segment, path_from_segments
from vehicles.messages import TruePose

HEADINGS = [0.0, math.pi / 2, math.pi, -math.pi / 2]
RUN_IN = 50.0
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
    "out, a bulb turn, and back 3.5 m beside": [
        Segment(60.0, 0.0),
        Segment(RADIUS * AWAY, -1 / RADIUS),
        Segment(RADIUS * (math.pi + 2 * AWAY), 1 / RADIUS),
        Segment(RADIUS * AWAY, -1 / RADIUS),
        Segment(60.0, 0.0),
    ],
}


def driven(
    path: Path, stations: Iterable[float], aside: Callable[[float], float] = lambda _: 0.0
) -> list[TruePose]:
    """Poses at `stations` of `path`, moved to its left by `aside` of the station (m)."""
    poses = []
    for seq, station in enumerate(stations):
        point = path.at(station)
        left = aside(station)
        east = point.east - left * math.sin(point.yaw)
        north = point.north + left * math.cos(point.yaw)
        poses.append(truth("v1", seq, east, north, yaw=point.yaw))
    return poses


def every(step: float, start: float, end: float) -> list[float]:
    return [start + step * k for k in range(round((end - start) / step))]


def feet(path: Path, stations: Sequence[float], aside: float) -> list[CrossTrack]:
    lead = DrivenPath.of(driven(path, every(STEP, 0.0, path.length)), RUN_IN)
    return cross_track(driven(path, stations, lambda _: aside), lead)


@pytest.mark.parametrize("yaw", HEADINGS)
@pytest.mark.parametrize("aside", [0.7, 0.0, -0.7])
def test_beside_a_straight_left_is_positive(yaw: float, aside: float) -> None:
    path = path_from_segments([Segment(200.0, 0.0)], 30.0, -40.0, yaw)
    stations = every(STEP, -45.0, 190.0)
    found = feet(path, stations, aside)
    assert [foot.at_ns for foot in found] == [at(seq / 50) for seq in range(len(stations))]
    for foot, station in zip(found, stations, strict=True):
        assert foot.lateral == pytest.approx(aside, abs=1e-9)
        assert foot.station == pytest.approx(station, abs=1e-9)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("inwards", [2.0, -2.0])
def test_a_concentric_circle_lies_beside_by_the_difference_of_radii(
    turn: int, inwards: float
) -> None:
    path = path_from_segments([Segment(300.0, turn / 100.0)])
    sagitta = STEP**2 / (8 * 100.0)
    found = feet(path, every(0.4, 0.0, 290.0), turn * inwards)
    assert len(found) == 725
    for foot, station in zip(found, every(0.4, 0.0, 290.0), strict=True):
        assert foot.lateral == pytest.approx(turn * inwards, abs=1.5 * sagitta)
        assert foot.station == pytest.approx(station, abs=0.02)


@pytest.mark.parametrize("name", SELF_MEETING)
@pytest.mark.parametrize("aside", [1.2, 0.0, -1.2])
def test_a_path_that_meets_itself_never_attracts_to_the_wrong_branch(
    name: str, aside: float
) -> None:
    path = path_from_segments(SELF_MEETING[name])
    stations = every(0.3, -30.0, path.length - 2.0)
    found = feet(path, stations, aside)
    for foot, station in zip(found, stations, strict=True):
        assert foot.lateral == pytest.approx(aside, abs=0.01)
        assert foot.station == pytest.approx(station, abs=0.05)


def test_standing_still_changes_nothing() -> None:
    path = path_from_segments([Segment(50.0, 0.0), Segment(100.0, 1 / 40)])
    stop = [60.0] * 500
    lead = driven(path, [*every(STEP, 0.0, 60.0), *stop, *every(STEP, 60.0, 140.0)])
    moving = driven(path, [*every(STEP, 0.0, 60.0), *every(STEP, 60.0, 140.0)])
    assert DrivenPath.of(lead, RUN_IN) == DrivenPath.of(moving, RUN_IN)
    own = driven(path, [*every(0.5, 0.0, 45.0), *[45.0] * 300, *every(0.5, 45.0, 130.0)])
    found = cross_track(own, DrivenPath.of(lead, RUN_IN))
    assert len(found) == len(own)
    assert max(abs(foot.lateral) for foot in found) < 0.002
    standing = {foot.station for foot in found[90:390]}
    assert len(standing) == 1


def test_a_lead_that_creeps_still_drives_a_path() -> None:
    path = path_from_segments([Segment(20.0, 1 / 30)])
    lead = DrivenPath.of(driven(path, every(0.004, 0.0, 20.0)), RUN_IN)
    assert lead.station[-1] == pytest.approx(20.0, abs=0.02)
    assert min(after - before for before, after in pairwise(lead.station)) > 0.01


def test_noise_of_a_standing_vehicle_moves_its_foot_back_and_forth() -> None:
    path = path_from_segments([Segment(100.0, 1 / 20)])
    lead = DrivenPath.of(driven(path, every(STEP, 0.0, 99.0)), RUN_IN)
    stations = [40.0 + 0.8 * math.sin(k) for k in range(200)]
    found = cross_track(driven(path, [*every(1.0, 0.0, 40.0), *stations]), lead)
    for foot, station in zip(found[40:], stations, strict=True):
        assert foot.station == pytest.approx(station, abs=0.01)
        assert foot.lateral == pytest.approx(0.0, abs=0.003)


def test_behind_the_lead_s_first_pose_its_line_counts() -> None:
    path = path_from_segments([Segment(100.0, 0.0)], yaw=0.3)
    lead = DrivenPath.of(driven(path, every(STEP, 0.0, 99.0)), 20.0)
    found = cross_track(driven(path, [-30.0, -20.5, -19.5, -10.0, -0.1, 0.1], lambda _: 0.5), lead)
    assert [foot.station for foot in found] == pytest.approx([-19.5, -10.0, -0.1, 0.1])
    assert [foot.lateral for foot in found] == pytest.approx([0.5] * 4)


@pytest.mark.parametrize("yaw", HEADINGS)
def test_where_the_road_behind_the_lead_is_known_it_does_not_matter_where_the_lead_faced(
    yaw: float,
) -> None:
    path = path_from_segments([Segment(100.0, 0.0)], yaw=yaw)
    lead = driven(path, every(STEP, 0.0, 99.0))
    lead[0] = replace(lead[0], yaw_rad=yaw + 0.6)
    own = driven(path, [-19.5, -10.0, -0.1, 0.1], lambda _: 0.5)
    found = cross_track(own, DrivenPath.of(lead, 20.0, road_yaw=yaw))
    assert [foot.station for foot in found] == pytest.approx([-19.5, -10.0, -0.1, 0.1])
    assert [foot.lateral for foot in found] == pytest.approx([0.5] * 4)


def test_past_the_lead_s_last_pose_there_is_nothing_to_compare_with() -> None:
    path = path_from_segments([Segment(100.0, 0.0)])
    lead = DrivenPath.of(driven(path, every(1.0, 0.0, 51.0)), RUN_IN)
    found = cross_track(driven(path, every(1.0, 0.0, 80.0), lambda _: 3.0), lead)
    assert len(found) == 51
    assert max(foot.station for foot in found) == pytest.approx(50.0)


def test_a_lead_that_never_moved_has_but_its_run_in() -> None:
    path = path_from_segments([Segment(100.0, 0.0)], yaw=1.0)
    lead = DrivenPath.of(driven(path, [0.0] * 10), 30.0)
    found = cross_track(driven(path, [-15.0, -8.0, 8.0], lambda _: -0.2), lead)
    assert [foot.station for foot in found] == pytest.approx([-15.0, -8.0])
    assert [foot.lateral for foot in found] == pytest.approx([-0.2, -0.2])


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
def test_turning_or_moving_the_world_changes_nothing(
    segments: list[Segment], turn: float, east: float, north: float
) -> None:
    here = path_from_segments(segments)
    there = path_from_segments(segments, east, north, turn)
    both = []
    for path in (here, there):
        lead = DrivenPath.of(driven(path, every(STEP, 0.0, path.length)), RUN_IN)
        both.append(cross_track(driven(path, every(1.1, -20.0, path.length), swerving), lead))
    ones, others = ({foot.at_ns: foot for foot in feet} for feet in both)
    assert len(ones.keys() ^ others.keys()) <= 2  # those on the very ends of the path
    for when in ones.keys() & others.keys():
        assert ones[when].lateral == pytest.approx(others[when].lateral, abs=1e-8)
        assert ones[when].station == pytest.approx(others[when].station, abs=1e-8)


@given(segments=curves)
@settings(max_examples=30)
def test_it_is_the_distance_to_the_nearest_place_where_the_path_does_not_meet_itself(
    segments: list[Segment],
) -> None:
    if sum(abs(s.curvature) * s.length for s in segments) > math.pi / 2:
        segments = [Segment(s.length, s.curvature * 0.2) for s in segments]
    path = path_from_segments([Segment(30.0, 0.0), *segments])
    lead_poses = driven(path, every(STEP, 0.0, path.length))
    own = driven(path, every(2.3, 5.0, path.length - 5.0), swerving)
    for foot, pose in zip(cross_track(own, DrivenPath.of(lead_poses, RUN_IN)), own, strict=True):
        assert abs(foot.lateral) == pytest.approx(nearest(pose, lead_poses), abs=0.01)


def nearest(pose: TruePose, path: Sequence[TruePose]) -> float:
    """Distance to the polyline, by trying a hundred places on each of its segments."""
    return min(
        math.hypot(
            one.east_m + share * (other.east_m - one.east_m) - pose.east_m,
            one.north_m + share * (other.north_m - one.north_m) - pose.north_m,
        )
        for one, other in pairwise(path)
        if math.hypot(one.east_m - pose.east_m, one.north_m - pose.north_m) < 5.0
        for share in (k / 100 for k in range(101))
    )
