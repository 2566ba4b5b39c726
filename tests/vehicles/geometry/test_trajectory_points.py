import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.transport import drive
from vehicles.geometry.arc_spline import Piece, points_along
from vehicles.messages import CompositeTrajectory

FINITE = st.floats(-1e3, 1e3)


def one_piece(
    east: float, north: float, yaw: float, curvature: float, length: float
) -> CompositeTrajectory:
    good = drive.trajectory("v2", 0)
    values = {name: getattr(good, name) for name in good.__dataclass_fields__}
    pieces = {
        "piece_east_m": (east,),
        "piece_north_m": (north,),
        "piece_yaw_rad": (yaw,),
        "piece_curvature_per_m": (curvature,),
        "piece_curvature_rate_per_m2": (0.0,),
        "piece_length_m": (length,),
    }
    return CompositeTrajectory(**{**values, **pieces})


@given(FINITE, FINITE, st.floats(-4, 4), st.floats(-0.12, 0.12), st.floats(0.1, 60))
def test_points_lie_on_the_circle_and_along_it(
    east: float, north: float, yaw: float, curvature: float, length: float
) -> None:
    points = points_along(one_piece(east, north, yaw, curvature, length), 1.0)
    assert points[0] == pytest.approx((east, north, yaw))
    assert points[-1][2] == pytest.approx(yaw + curvature * length, abs=1e-9)
    assert len(points) == math.ceil(length) + 1
    if abs(curvature) > 1e-3:
        centre_east = east - math.sin(yaw) / curvature
        centre_north = north + math.cos(yaw) / curvature
        for x, y, _ in points:
            radius = math.hypot(x - centre_east, y - centre_north)
            assert radius == pytest.approx(1.0 / abs(curvature), abs=1e-6)
    for (x, y, _), (next_x, next_y, _) in pairwise(points):
        assert math.hypot(next_x - x, next_y - y) <= 1.0 + 1e-9


def test_a_clothoid_is_drawn_where_it_is() -> None:
    drawn = replace(one_piece(3.0, 4.0, 0.5, 0.01, 12.0), piece_curvature_rate_per_m2=(0.005,))
    piece = Piece(3.0, 4.0, 0.5, 0.01, 12.0, 0.005)
    for k, (east, north, yaw) in enumerate(points_along(drawn, 1.0)):
        place = piece.at(float(k))
        assert (east, north, yaw) == pytest.approx((place.east, place.north, place.yaw))


def test_a_left_bend_turns_left() -> None:
    *_, (east, north, yaw) = points_along(one_piece(0.0, 0.0, 0.0, 0.1, 10.0), 1.0)
    assert east > 0.0
    assert north > 0.0
    assert yaw == pytest.approx(1.0)


@pytest.mark.parametrize("rate", [9e307, -1.7e308])
def test_a_piece_that_turns_without_end_is_skipped(rate: float) -> None:
    wild = replace(one_piece(0.0, 0.0, 0.0, 0.1, 37.0), piece_curvature_rate_per_m2=(rate,))
    assert points_along(wild, 1.0) == []
