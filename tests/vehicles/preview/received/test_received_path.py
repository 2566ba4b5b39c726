"""Path histories of a source in its trace: closed holes, late joiners, invalid histories."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.scenario import load_scenario
from tests.made.examples import examples
from tests.made.vehicles.sent_paths import fixes, sent, without_history
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments
from vehicles.preview.samples import Window
from vehicles.preview.trace import Trace
from vehicles.received_pose import ReceivedPose

SPEED = 15.0
STEP = SPEED / 20.0
ROADS = {
    "straight": path_from_segments([Segment(500.0, 0.0)], yaw=1.0),
    "arc": path_from_segments([Segment(500.0, 1 / 100)], 5.0, 7.0, 2.0),
    "slalom": path_from_segments([Segment(20.0, (-1) ** k / 50) for k in range(25)], yaw=-3.0),
    "clothoids": path_from_segments(
        [Segment(0.5, 0.03 * math.sin(k / 60.0)) for k in range(1000)], yaw=0.3
    ),
    "corner": path_from_segments([Segment(230.0, 0.0), Segment(12.0, 1 / 8), Segment(258.0, 0.0)]),
}
CUT = range(280, 340)
"""Numbers of the poses lost in a cut of 3 s."""


def poses(road: SampledPath, noise: float = 0.0, **limits: float) -> list[ReceivedPose]:
    stations = np.arange(0.0, road.station[-1] - 1.0, STEP)
    return list(sent(fixes(road, stations, noise), **limits))  # type: ignore[arg-type]


def worst(road: SampledPath, trace: Trace, station: float, span: float = 80.0) -> float:
    """Largest distance (m) from the road within `span` (m) of `station` as the car drives there."""
    for here in np.arange(0.0, station, 1.0):
        trace.window(*place(road, here), 5.0, 5.0)
    return farthest(road, trace.window(*place(road, station), span, span), station)


def place(road: SampledPath, station: float) -> tuple[float, float]:
    point = road.at(station)
    return point.east, point.north


def received(
    source: Sequence[ReceivedPose], lost: range = CUT, *, after_hole: bool = True
) -> Trace:
    trace = Trace()
    for number, pose in enumerate(source):
        if number not in lost:
            trace.add(pose, after_hole=after_hole and number == lost.stop)
    return trace


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("name", ROADS)
def test_a_cut_of_3_s_leaves_no_hole(name: str, noise: float) -> None:
    road = ROADS[name]
    trace = received(poses(road, noise))
    assert trace.holes == []
    assert worst(road, trace, CUT.start * STEP + 20.0) < 0.10


@pytest.mark.parametrize("name", ["church_lot", "highway"])
def test_cuts_on_recorded_roads_leave_no_hole(name: str) -> None:
    road = load_scenario(name).route.path
    for start in range(0, min(int(road.station[-1]), 2000) - 200, 75):
        stations = np.arange(float(start), start + 200.0, 0.3)
        source = list(sent(fixes(road, stations, 0.02)))
        trace = received(source, range(250, 350))
        assert trace.holes == []
        here = start + 250 * 0.3
        for passed in np.arange(start, here, 1.0):
            trace.window(*place(road, passed), 5.0, 5.0)
        window = trace.window(*place(road, here), 20.0, 60.0)
        assert farthest(road, window, here) < 0.12


def test_what_the_history_does_not_reach_remains_a_hole() -> None:
    road = ROADS["arc"]
    source = poses(road, length=20.0)
    trace = received(source)
    last = (CUT.start - 1) * STEP
    worst(road, trace, 203.0)
    ((begin, end),) = trace.holes
    assert begin == pytest.approx(last, abs=0.2)
    assert end == pytest.approx(CUT.stop * STEP - 20.0, abs=6.0)
    ego = place(road, begin - 5.0)
    seen = trace.without_bridges(trace.window(*ego, 5.0, 80.0))
    ahead = seen.station + begin - 5.0
    assert not [one for one in ahead if begin + 0.5 < one < end - 0.5]
    assert [one for one in ahead if end < one < CUT.stop * STEP - 2.0]


@pytest.mark.parametrize("name", ROADS)
def test_a_late_joiner_receives_the_path_up_to_it(name: str) -> None:
    road = ROADS[name]
    source = poses(road, 0.02)
    joined, guessed = Trace(), Trace()
    ego = road.at(222.0)
    for pose in source[340:380]:
        joined.add(pose)
        joined.bridge(ego.east, ego.north, ego.yaw)
        guessed.add(without_history(pose))
        guessed.bridge(ego.east, ego.north, ego.yaw)
    window = joined.window(ego.east, ego.north, 10.0, 60.0)
    assert window.station[0] < -5.0
    assert joined.known_ahead(ego.east, ego.north) == pytest.approx(379 * STEP - 222.0, abs=0.5)
    assert farthest(road, window) < 0.10
    if name != "straight":
        assert farthest(road, guessed.window(ego.east, ego.north, 10.0, 60.0)) > 0.3


def farthest(road: SampledPath, window: Window, station: float = 222.0) -> float:
    """Largest distance (m) from the road of samples around `station` (m)."""
    rows = zip(*(row.tolist() for row in window), strict=True)
    return max(
        abs(road.project(east, north, station + along).lateral) for east, north, along in rows
    )


ARC = poses(ROADS["arc"], length=120.0)
units = st.integers(-(2**31), 2**31 - 1)


@examples(33, 1000)
@given(st.lists(st.tuples(units, units, units), max_size=40), st.booleans())
def test_no_history_raises(deltas: list[tuple[int, int, int]], late: bool) -> None:
    source = ARC[:60]
    columns = [tuple(row[k] for row in deltas) for k in range(3)]
    hostile = replace(
        source[59].message,
        history_latitude_e7deg=columns[0],
        history_longitude_e7deg=columns[1],
        history_age_cs=columns[2],
    )
    trace = Trace()
    if not late:
        for pose in source[:20]:
            trace.add(pose)
    trace.add(replace(source[59], message=hostile), after_hole=not late)
    trace.bridge(0.0, 0.0, 0.0)
    window = trace.window(source[30].east, source[30].north, 10.0, 40.0)
    assert all(np.isfinite(row).all() for row in window)
    assert (np.diff(window.station) > 0.0).all()
