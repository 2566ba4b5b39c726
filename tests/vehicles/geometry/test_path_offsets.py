"""Offsets of many points, compared with the projection of each."""

import math

import numpy as np
import pytest

from vehicles.geometry.path_offsets import path_offsets
from vehicles.geometry.sampled_path import SampledPath, Segment, path_from_segments

PATH = path_from_segments(
    (
        Segment(60.0, 0.0),
        Segment(math.pi * 12.0, 1 / 12.0),
        Segment(80.0, 0.0),
        Segment(40.0, -1 / 30.0),
    )
)


def test_offsets_equal_those_of_single_projections() -> None:
    random = np.random.default_rng(5)
    near = random.uniform(-8.0, PATH.length + 8.0, 3000)
    beside = random.uniform(-11.0, 11.0, near.size)
    feet = [PATH.at(station) for station in near.tolist()]
    points = np.array(
        [
            (foot.east - off * math.sin(foot.yaw), foot.north + off * math.cos(foot.yaw))
            for foot, off in zip(feet, beside.tolist(), strict=True)
        ]
    ).T
    near += random.uniform(-6.0, 6.0, near.size)
    single = [
        PATH.project(x, y, station).lateral
        for (x, y), station in zip(points.T.tolist(), near.tolist(), strict=True)
    ]
    assert path_offsets(PATH, points, near) == pytest.approx(single, abs=1e-9)


def test_no_points_have_no_offsets() -> None:
    assert path_offsets(PATH, np.zeros((2, 0)), np.zeros(0)).size == 0


def test_an_offset_to_the_left_is_positive() -> None:
    straight = SampledPath(*np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [9.0, 9.0, 0.0, 0.0, 0.0]]).T)
    assert path_offsets(straight, np.array([[4.0], [1.5]]), np.array([3.0])) == pytest.approx([1.5])
