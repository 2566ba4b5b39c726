"""What is computed by columns equals what is computed one by one."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from transport.picture.series.log_series import due
from transport.picture.series.trajectory_rows import PieceColumns, all_points_along
from vehicles.geometry.trajectory_points import LONGEST_M, points_along
from vehicles.messages import CompositeTrajectory
from vehicles.schedule import Timer

PIECE = st.tuples(
    st.floats(-1e3, 1e3),
    st.floats(-1e3, 1e3),
    st.floats(-4, 4),
    st.floats(-0.2, 0.2),
    st.sampled_from([0.0, 1e-4, -1e-3, math.nan]),
    st.sampled_from([-1.0, 0.0, 0.4, 17.3, LONGEST_M, math.inf]),
)


def trajectory(pieces: list[tuple[float, ...]]) -> CompositeTrajectory:
    east, north, yaw, curvature, rate, length = zip(*pieces, strict=True) if pieces else [()] * 6
    return CompositeTrajectory(
        vehicle="v2", seq=0, decided_at_ns=0, mode="composite",
        piece_east_m=east, piece_north_m=north, piece_yaw_rad=yaw,
        piece_curvature_per_m=curvature, piece_curvature_rate_per_m2=rate, piece_length_m=length,
        sample_east_m=(), sample_north_m=(), sample_source=(),
        residual_m_rms=0.0, residual_m_max=0.0,
    )  # fmt: skip


@given(st.lists(st.lists(PIECE, max_size=3), max_size=4))
def test_points_of_many_trajectories_are_those_of_each(
    trajectories: list[list[tuple[float, ...]]],
) -> None:
    pieces = np.array([piece for one in trajectories for piece in one]).reshape(-1, 6)
    offsets = np.cumsum([0, *map(len, trajectories)])
    counts, points = all_points_along(PieceColumns(offsets, *pieces.T), 1.0)
    expected = [points_along(trajectory(one), 1.0) for one in trajectories]
    assert counts.tolist() == list(map(len, expected))
    places = [place[:2] for one in expected for place in one]
    assert points.tolist() == pytest.approx(places and np.array(places), abs=1e-6)


@given(st.lists(st.integers(0, 1000), max_size=50), st.integers(0, 300))
def test_a_timer_is_due_at_the_same_rows(at: list[int], period: int) -> None:
    timer = Timer(period)
    expected = [row for row, now in enumerate(at) if period == 0 or timer.is_due(now)]
    assert due(np.array(at, np.int64), period).tolist() == expected
