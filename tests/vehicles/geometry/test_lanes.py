import numpy as np
import pytest

from vehicles.geometry.lanes import lane_edges, simplified

ANGLE = np.linspace(0.0, np.pi, 400)
ARC = 20.0 * np.column_stack([np.cos(ANGLE), np.sin(ANGLE)])


def test_a_simplified_path_keeps_its_ends_and_its_course() -> None:
    few = simplified(ARC[:, 0], ARC[:, 1])
    assert len(few) < 100
    assert np.array_equal(few[[0, -1]], ARC[[0, -1]])
    middles = 0.5 * (few[1:] + few[:-1])
    assert np.hypot(*middles.T) == pytest.approx(20.0, abs=0.02)


def test_a_straight_is_cut_at_the_spacing() -> None:
    few = simplified(np.arange(101.0), np.zeros(101), spacing=20.0)
    assert np.diff(few[:, 0]).max() <= 20.0
    assert len(few) <= 8


def test_edges_are_half_a_lane_from_the_path() -> None:
    left, right = lane_edges(ARC, 3.5)  # in a left turn the left edge is the inner one
    assert np.hypot(*left.T) == pytest.approx(18.25, abs=0.01)
    assert np.hypot(*right.T) == pytest.approx(21.75, abs=0.01)
