"""The known path ends at the first hole that no received position covers."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made.transport.received_poses import received
from vehicles.geometry.bridges import curve_between
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.preview.trace import CERTAIN, LEAST_BEND, PathHole, Trace, known_path
from vehicles.schedule import SECOND

SPEED = 10.0
"""Speed (m/s) of the sources, which send a pose every metre."""
ROADS = {
    "straight": path_from_segments([Segment(500.0, 0.0)], yaw=1.0),
    "left": path_from_segments([Segment(500.0, 1 / 100)], 5.0, 7.0, 2.0),
    "bends": path_from_segments(
        [Segment(60.0, 0.0), Segment(60.0, -1 / 40), Segment(60.0, 1 / 40), Segment(300.0, 0.0)]
    ),
}


def received_at(path: SampledPath, stations: list[tuple[int, int]]) -> Trace:
    """Trace of a source received from each first to each last of these stations (m)."""
    trace = Trace()
    for number, (first, last) in enumerate(stations):
        for station in range(first, last + 1):
            point = path.at(float(station))
            pose = received(
                round(station / SPEED * SECOND), point.east, point.north, point.yaw, SPEED
            )
            trace.add(pose, after_hole=number > 0 and station == first)
    return trace


def driven(path: SampledPath, traces: list[Trace], until: int) -> list[tuple[float, float]]:
    """Station of the car, and that of the end of its known path, at every metre."""
    ends: list[tuple[float, float]] = []
    for station in range(until):
        point = path.at(float(station))
        ends.append((station, station + known_path(traces, point.east, point.north).end))
    return ends


@pytest.mark.parametrize("road", ROADS)
def test_the_known_path_ends_at_a_hole_until_the_car_is_beyond_it(road: str) -> None:
    path = ROADS[road]
    trace = received_at(path, [(0, 80), (110, 200)])
    for station, end in driven(path, [trace], 190):
        if station <= 80:
            assert end == pytest.approx(80.0, abs=0.6)
        elif 83 < station < 107:  # the bridge is not as long as the road, in bends
            assert end == pytest.approx(80.0, abs=3.0)
        elif station > 115:
            assert end == pytest.approx(200.0, abs=3.0)


def test_a_hole_of_both_sources_is_shorter_than_that_of_each() -> None:
    path = ROADS["straight"]
    lead, predecessor = (
        received_at(path, [(0, 80), (160, 250)]),
        received_at(path, [(0, 50), (130, 220)]),
    )
    point = path.at(10.0)
    known = known_path([lead, predecessor], point.east, point.north)
    assert known.end == pytest.approx(70.0, abs=0.5)
    assert known.hole is not None


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_all_of_the_known_path_was_received(data: st.DataObject) -> None:
    """By sets of metres of the road that either source was received on."""
    road = data.draw(st.sampled_from(sorted(ROADS)))
    edges = st.lists(st.integers(20, 250), min_size=2, max_size=5, unique=True).map(sorted)
    stations = []
    for _ in range(2):
        marks = [0, *data.draw(edges), 300]
        stations.append([(a, b) for a, b in zip(marks[::2], marks[1::2], strict=False)])
    path = ROADS[road]
    covered = {metre for parts in stations for a, b in parts for metre in range(a, b + 1)}
    missing = sorted(set(range(301)) - covered)
    # A stretch of less than 5 m without positions is no hole.
    traces = [received_at(path, parts) for parts in stations]
    car = data.draw(st.integers(0, 19))
    point = path.at(float(car))
    known = known_path(traces, point.east, point.north)
    unknown = [metre for metre in missing if metre < car + known.end - 1.0]
    assert len(unknown) <= 4 * 5
    if known.hole is None:
        assert known.end + car == pytest.approx(max(covered), abs=4.0)


# ---- Holes that a car may cross


@settings(max_examples=50, deadline=None)
@given(
    st.floats(6.0, 60.0),
    st.floats(LEAST_BEND, 0.1),
    st.lists(st.sampled_from([-1.0, 0.0, 1.0]), min_size=1, max_size=6),
)
def test_across_a_certain_hole_the_bridge_is_close_to_the_road(
    length: float, bend: float, turns: list[float]
) -> None:
    part = length / len(turns)
    path = path_from_segments(
        [Segment(20.0, 0.0), *(Segment(part, turn * bend) for turn in turns), Segment(20.0, 0.0)]
    )
    start, end = path.at(20.0), path.at(20.0 + length)
    if not PathHole(length, 0.0).is_certain(bend):
        return
    before, after = (start.east, start.north, start.yaw), (end.east, end.north, end.yaw)
    for _, east, north, _ in curve_between((0, *before), (0, *after), 0.5):
        assert abs(path.project(east, north, None).lateral) <= 1.05 * CERTAIN


def test_a_source_that_drove_round_and_back_leaves_a_long_hole() -> None:
    """From end to end the hole is 8 m long, but the source drove 46 m."""
    path = path_from_segments(
        [Segment(30.0, 0.0), Segment(2 * math.pi * 6.0, 1 / 6.0), Segment(60.0, 0.0)]
    )
    trace = received_at(path, [(0, 26), (72, 110)])
    point = path.at(10.0)
    known = known_path([trace], point.east, point.north)
    assert known.end == pytest.approx(16.0, abs=0.6)
    assert known.hole is not None
    assert known.hole.length == pytest.approx(46.0, rel=0.1)
    assert not known.hole.is_certain(1 / 6.0)
