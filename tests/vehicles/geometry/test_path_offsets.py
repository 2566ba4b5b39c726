"""Offsets of many points, compared with the projection of each."""

import math

import numpy as np
import pytest

from vehicles.geometry.driven_path import PathWalk
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments

PATH = path_from_segments(
    (
        Segment(60.0, 0.0),
        Segment(math.pi * 12.0, 1 / 12.0),
        Segment(80.0, 0.0),
        Segment(40.0, -1 / 30.0),
    )
)


def test_feet_equal_those_of_single_projections() -> None:
    """Up to the sagitta of the chords between samples: 1 mm at a radius of 8 m."""
    along = np.arange(-8.0, PATH.length + 8.0, 0.3)
    beside = 4.0 * np.sin(along / 9.0)
    feet = [PATH.at(station) for station in along.tolist()]
    points = np.array(
        [
            (foot.east - off * math.sin(foot.yaw), foot.north + off * math.cos(foot.yaw))
            for foot, off in zip(feet, beside.tolist(), strict=True)
        ]
    ).T
    station, offset = PathWalk(PATH, -8.0).feet(points, along + 8.0)
    assert offset == pytest.approx(beside, abs=1.5e-3)
    assert station == pytest.approx(along, abs=0.1)


def test_an_offset_to_the_left_is_positive() -> None:
    straight = SampledPath(*np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [9.0, 9.0, 0.0, 0.0, 0.0]]).T)
    walk = PathWalk(straight, 0.0)
    assert walk.foot(4.0, 1.5, 3.0) == pytest.approx((4.0, 1.5))


def test_a_walk_keeps_to_its_lap_of_a_path_that_repeats() -> None:
    """Two laps of a circle, the second 2 m further out; positions were not recorded for 40 m."""
    laps = (Segment(2.0 * math.pi * 20.0, 1 / 20.0), Segment(2.0 * math.pi * 22.0, 1 / 22.0))
    path = path_from_segments(laps)
    walk = PathWalk(path, 0.0)
    for k in range(520):
        if 150 < k < 230:
            continue
        place = path.at(0.5 * k)
        _, offset = walk.foot(place.east, place.north, 0.5 * k)
        assert offset == pytest.approx(0.0, abs=2e-3)
