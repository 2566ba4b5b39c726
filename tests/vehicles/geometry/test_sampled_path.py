import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.examples import examples
from vehicles.geometry.sampled_path import (
    SAMPLING,
    PathPoint,
    SampledPath,
    Segment,
    path_from_segments,
)

FIGURE_OF_EIGHT = [Segment(2 * math.pi * 15, 1 / 15), Segment(2 * math.pi * 15, -1 / 15)]


def point_at(point: PathPoint, lateral: float) -> tuple[float, float]:
    return (point.east - lateral * math.sin(point.yaw), point.north + lateral * math.cos(point.yaw))


def exact(
    segments: Sequence[Segment], station: float, start: tuple[float, float, float]
) -> tuple[float, float, float]:
    """East, north, yaw by rotation about each segment's centre, an independent formula."""
    east, north, yaw = start
    for segment in segments:
        distance = min(station, segment.length)
        station -= distance
        if segment.curvature == 0.0:
            east, north = east + distance * math.cos(yaw), north + distance * math.sin(yaw)
        else:
            radius = 1.0 / segment.curvature
            centre = (east - radius * math.sin(yaw), north + radius * math.cos(yaw))
            yaw += distance * segment.curvature
            east = centre[0] + radius * math.sin(yaw)
            north = centre[1] - radius * math.cos(yaw)
    return east, north, yaw


curvatures = st.floats(-0.125, 0.125).map(lambda curvature: round(curvature, 5))
segments_drawn = st.lists(
    st.builds(Segment, st.floats(0.5, 60.0), curvatures), min_size=1, max_size=5
)


@given(segments=segments_drawn, yaw=st.floats(-3.0, 3.0), share=st.floats(0.0, 1.0))
@examples(10, 60)
def test_path_follows_straights_and_arcs_exactly(
    segments: list[Segment], yaw: float, share: float
) -> None:
    path = path_from_segments(segments, 10.0, -20.0, yaw)
    assert path.length == pytest.approx(sum(s.length for s in segments))
    assert np.max(np.diff(path.station)) <= SAMPLING + 1e-9
    station = share * path.length
    point = path.at(station)
    east, north, direction = exact(segments, station, (10.0, -20.0, yaw))
    assert math.hypot(point.east - east, point.north - north) < 1e-6
    assert point.yaw == pytest.approx(direction, abs=1e-5)  # a corner is within a millimetre


def test_left_is_positive_in_all_four_headings() -> None:
    for yaw in (0.0, math.pi / 2, math.pi, -math.pi / 2):
        for curvature in (0.05, 0.0, -0.05):
            path = path_from_segments([Segment(20.0, curvature)], yaw=yaw)
            point = path.at(11.1)
            assert point.yaw == pytest.approx(yaw + 11.1 * curvature)
            for lateral in (1.5, -1.5):
                foot = path.project(*point_at(point, lateral), 10.0)
                assert foot.lateral == pytest.approx(lateral, abs=1e-9)
                assert foot.station == pytest.approx(11.1, abs=1e-6)
                assert foot.curvature == curvature


@given(
    segments=segments_drawn, share=st.floats(0.0, 1.0), lateral=st.floats(-3.0, 3.0),
    off=st.floats(-4.0, 4.0),
)  # fmt: skip
@examples(13, 80)
def test_projection_inverts_the_offset_of_a_point(
    segments: list[Segment], share: float, lateral: float, off: float
) -> None:
    path = path_from_segments(segments)
    station = share * path.length
    point = path.at(station)
    foot = path.project(*point_at(point, lateral), station + off)
    assert foot.station == pytest.approx(station, abs=1e-4)
    assert foot.lateral == pytest.approx(lateral, abs=1e-6)
    assert foot.yaw == pytest.approx(point.yaw, abs=1e-5)


def test_beyond_its_ends_a_path_continues_straight() -> None:
    path = path_from_segments([Segment(10.0, 0.1)], yaw=1.0)
    start, end = path.at(-4.0), path.at(13.0)
    assert (start.east, start.north) == pytest.approx((-4 * math.cos(1.0), -4 * math.sin(1.0)))
    assert (start.yaw, start.curvature) == (1.0, 0.0)
    last = path.at(10.0)
    assert last.curvature == 0.1
    assert math.hypot(end.east - last.east, end.north - last.north) == pytest.approx(3.0)
    assert (end.yaw, end.curvature) == (last.yaw, 0.0)
    for station, near in ((-4.0, 0.0), (13.0, 10.0), (30.0, 28.0), (-30.0, -31.0)):
        foot = path.project(*point_at(path.at(station), 0.7), near)
        assert foot.station == pytest.approx(station, abs=1e-9)
        assert foot.lateral == pytest.approx(0.7, abs=1e-9)


def test_a_figure_of_eight_is_followed_in_order_through_its_crossing() -> None:
    path = path_from_segments(FIGURE_OF_EIGHT * 2)
    near, last = 0.0, -1.0
    for k in range(1, round(path.length / 0.4)):
        foot = path.project(*point_at(path.at(0.4 * k), 0.3 * math.sin(k)), near)
        assert foot.station == pytest.approx(0.4 * k, abs=1e-3)
        assert foot.station > last
        near = last = foot.station


def test_invalid_paths_are_rejected() -> None:
    ramp, flat = np.arange(3.0), np.zeros(3)
    with pytest.raises(ValueError, match="same length"):
        SampledPath(ramp, flat, flat, flat, np.zeros(2))
    with pytest.raises(ValueError, match="two samples"):
        SampledPath(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))
    with pytest.raises(ValueError, match="finite"):
        SampledPath(ramp, flat, flat, flat, np.array([0.0, math.nan, 0.0]))
    with pytest.raises(ValueError, match="increase"):
        SampledPath(flat, ramp, flat, flat, flat)
    with pytest.raises(ValueError, match="at least one segment"):
        path_from_segments([])
    for segment in (Segment(0.0, 0.0), Segment(math.inf, 0.0), Segment(10.0, math.nan)):
        with pytest.raises(ValueError, match="Segment"):
            path_from_segments([segment])
