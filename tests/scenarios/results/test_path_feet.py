"""Feet of followers on the lead's driven path: stations and signed offsets."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenarios.results.true_motion import path_feet
from tests.made.examples import examples
from tests.made.scenarios.messages import truth
from tests.made.scenarios.tables import run_of
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
    stations: Sequence[float],
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
        pose = truth(vehicle, seq, east, north, yaw=point.yaw, distance=station - stations[0])
        poses.append(pose)
    return poses


def every(step: float, start: float, end: float) -> list[float]:
    return [start + step * k for k in range(round((end - start) / step))]


def cross_track(
    own: Sequence[TruePose], lead: Sequence[TruePose], yaw: float = 0.0
) -> list[tuple[float, float]]:
    """Stations and offsets of a follower on the path of a lead whose road begins at a yaw."""
    heading_deg = (90.0 - math.degrees(yaw)) % 360.0
    poses = [replace(pose, vehicle="v2") for pose in own]
    run = run_of(*lead, *poses, count=2, overrides=[f"path.heading_deg={heading_deg!r}"])
    found = path_feet(run, "v2")
    return list(zip(found.station.tolist(), found.lateral.tolist(), strict=True))


def feet(path: SampledPath, stations: Sequence[float], offset: float) -> list[tuple[float, float]]:
    lead = driven(path, every(STEP, 0.0, path.length))
    return cross_track(driven(path, stations, lambda _: offset), lead)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("inwards", [2.0, -2.0])
def test_a_concentric_circle_has_the_difference_of_radii(turn: int, inwards: float) -> None:
    path = path_from_segments([Segment(300.0, turn / 100.0)])
    sagitta = STEP**2 / (8 * 100.0)
    result = feet(path, every(0.4, 0.0, 290.0), turn * inwards)
    assert len(result) == 725
    for (at, lateral), station in zip(result, every(0.4, 0.0, 290.0), strict=True):
        assert lateral == pytest.approx(turn * inwards, abs=1.5 * sagitta)
        assert at == pytest.approx(station, abs=0.02)


@pytest.mark.parametrize("name", SELF_MEETING)
@pytest.mark.parametrize("offset", [1.2, 0.0, -1.2])
def test_on_a_path_that_meets_itself_the_foot_stays_on_its_branch(name: str, offset: float) -> None:
    path = path_from_segments(SELF_MEETING[name])
    stations = every(0.3, -30.0, path.length - 2.0)
    result = feet(path, stations, offset)
    for (at, lateral), station in zip(result, stations, strict=True):
        assert lateral == pytest.approx(offset, abs=0.01)
        assert at == pytest.approx(station, abs=0.05)


@pytest.mark.parametrize("yaw", HEADINGS)
def test_the_straight_before_the_start_has_the_direction_of_the_road(yaw: float) -> None:
    path = path_from_segments([Segment(100.0, 0.0)], yaw=yaw)
    lead = driven(path, every(STEP, 0.0, 99.0))
    lead[0] = replace(lead[0], yaw_rad=yaw + 0.6)
    own = driven(path, [-19.5, -10.0, -0.1, 0.1], lambda _: 0.5)
    found = cross_track(own, lead, yaw)
    assert [station for station, _ in found] == pytest.approx([-19.5, -10.0, -0.1, 0.1])
    assert [lateral for _, lateral in found] == pytest.approx([0.5] * 4)


@pytest.mark.parametrize("heading", range(0, 360, 45))
def test_left_of_a_straight_is_positive_in_all_headings(heading: int) -> None:
    """Beyond the end of the lead's path nothing is known."""
    path = path_from_segments([Segment(60.0, 0.0)], yaw=math.radians(heading))
    lead = driven(path, every(1.0, 0.0, 30.0))
    for left in (0.3, -0.2):
        own = driven(path, [-12.0, 7.5, 40.0], lambda _, left=left: left)  # type: ignore[misc]
        *known, beyond = cross_track(own, lead, math.radians(heading))
        assert [station for station, _ in known] == pytest.approx([-12.0, 7.5])
        assert [lateral for _, lateral in known] == pytest.approx([left] * 2)
        assert math.isnan(beyond[1])


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
    stops=st.tuples(st.integers(5, 100), st.integers(5, 100), st.integers(0, 60)),
)
@examples(8, 40)
def test_the_offset_is_that_of_the_nearest_place_on_its_branch(
    course: str, offset: float, stops: tuple[int, int, int]
) -> None:
    path = path_from_segments(COURSES[course], 40.0, -7.0)
    lead_stop, own_stop, ticks = stops
    lead = driven(path, with_stop(every(STEP, 0.0, path.length), lead_stop, ticks))
    own = driven(
        path,
        with_stop(every(0.55, -15.0, path.length - 2.0), own_stop, ticks),
        lambda _: offset,
    )
    found = [lateral for _, lateral in cross_track(own, lead)]
    assert found == pytest.approx(projected(own, lead, 0.0), abs=0.02)


# ---- Against geometry


def swerving(station: float) -> float:
    return 0.8 * math.sin(station / 13.0)


curves = st.lists(
    st.builds(Segment, st.floats(5.0, 40.0), st.floats(-0.04, 0.04)), min_size=1, max_size=5
)


@given(segments=curves)
@settings(max_examples=30)
def test_on_a_simple_path_it_is_the_distance_to_the_nearest_point(segments: list[Segment]) -> None:
    if sum(abs(s.curvature) * s.length for s in segments) > math.pi / 2:
        segments = [Segment(s.length, s.curvature * 0.2) for s in segments]
    path = path_from_segments([Segment(30.0, 0.0), *segments])
    lead_poses = driven(path, every(STEP, 0.0, path.length))
    own = driven(path, every(2.3, 5.0, path.length - 5.0), swerving)
    for (_, lateral), pose in zip(cross_track(own, lead_poses), own, strict=True):
        assert abs(lateral) == pytest.approx(nearest(pose, lead_poses), abs=0.01)


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
