"""Bodies against brute force: by sampling their edges, and by cutting one with another."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from scenarios.results.encounters import BodySize, CarBody, body_of, corners, overlap, separation
from tests.made.examples import examples
from tests.made.scenarios.messages import truth
from tests.made.scenarios.polygons import common_area
from vehicles.car.parameters import LINCOLN_MKZ


def placed(
    east: float, north: float, yaw: float, length: float = 4.93, width: float = 1.86
) -> CarBody:
    return body_of(truth("v1", 0, east, north, yaw=yaw), BodySize(length, width, 0.0))


bodies = st.builds(
    placed,
    st.floats(-6, 6),
    st.floats(-6, 6),
    st.floats(-math.pi, math.pi),
    st.floats(0.5, 12),
    st.floats(0.3, 3),
)


def edge(body: CarBody, steps: int = 60) -> NDArray[np.float64]:
    ring = [*corners(body), corners(body)[0]]
    return np.concatenate([np.linspace(a, b, steps) for a, b in pairwise(ring)])


@given(one=bodies, other=bodies)
@examples(44, 400)
def test_bodies_overlap_where_they_share_an_area(one: CarBody, other: CarBody) -> None:
    area = common_area(one, other)
    assume(not 0.0 < area < 1e-9)
    assert overlap(one, other) == overlap(other, one) == (area > 0.0)


@given(one=bodies, other=bodies)
@examples(16, 100)
def test_the_distance_is_that_of_the_nearest_points_of_their_edges(
    one: CarBody, other: CarBody
) -> None:
    found = separation(one, other)
    assert found.distance == pytest.approx(separation(other, one).distance)
    if overlap(one, other):
        assert found.distance == 0.0
        return
    apart = edge(one)[:, None, :] - edge(other)[None, :, :]
    nearest = float(np.hypot(apart[..., 0], apart[..., 1]).min())
    assert found.distance <= nearest + 1e-9
    assert found.distance == pytest.approx(nearest, abs=0.2)  # samples lie up to 0.2 m apart


@given(one=bodies, other=bodies, speeds=st.tuples(*[st.floats(-20, 20)] * 4))
@examples(16, 100)
def test_the_closing_speed_is_the_rate_of_the_distance(
    one: CarBody, other: CarBody, speeds: tuple[float, float, float, float]
) -> None:
    step = 1e-6
    one = replace(one, speed_east=speeds[0], speed_north=speeds[1])
    other = replace(other, speed_east=speeds[2], speed_north=speeds[3])

    def after(body: CarBody, span: float) -> CarBody:
        return replace(
            body,
            east=body.east + span * body.speed_east,
            north=body.north + span * body.speed_north,
        )

    before, now, then = (
        separation(after(one, span), after(other, span)) for span in (-step, 0.0, step)
    )
    assume(before.distance > 1e-3 and then.distance > 1e-3)
    ways = [(now.distance - before.distance) / step, (then.distance - now.distance) / step]
    assume(abs(ways[0] - ways[1]) < 1e-2)  # else another corner becomes the nearest
    assert now.closing == pytest.approx(-ways[1], abs=2e-2)


def test_the_body_reaches_as_far_beyond_either_axle() -> None:
    """The pose is that of the centre of mass, which lies ahead of the middle of this car."""
    pose = truth("v1", 0, 100.0, 50.0, yaw=math.pi / 2)
    size = BodySize.of(LINCOLN_MKZ)
    norths = [north for _, north in corners(body_of(pose, size))]
    front, rear = max(norths), min(norths)
    assert front - rear == pytest.approx(4.93)
    overhang = front - (50.0 + LINCOLN_MKZ.front_axle_distance)
    assert overhang == pytest.approx((50.0 - LINCOLN_MKZ.rear_axle_distance) - rear)
    assert overhang > 0.9


def test_a_body_moves_as_its_centre_does() -> None:
    """Sideways and with the yaw rate at the distance from the centre of mass."""
    size = BodySize(5.0, 2.0, 2.0)
    pose = replace(truth("v1", 0, 0.0, 0.0, yaw=0.3), lateral_speed_mps=0.5, yaw_rate_radps=0.2)
    span = 1e-6
    moved = replace(
        pose,
        east_m=(20.0 * math.cos(0.3) - 0.5 * math.sin(0.3)) * span,
        north_m=(20.0 * math.sin(0.3) + 0.5 * math.cos(0.3)) * span,
        yaw_rad=0.3 + 0.2 * span,
    )
    now, then = body_of(pose, size), body_of(moved, size)
    assert (then.east - now.east) / span == pytest.approx(now.speed_east, abs=1e-4)
    assert (then.north - now.north) / span == pytest.approx(now.speed_north, abs=1e-4)
