import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.arc_courses import course, point_at
from vehicles.driver.own_state import Pose
from vehicles.driver.tracking import SPACING, PathBehind, TrackingErrors, track

HEADINGS = {"east": 0.0, "north": math.pi / 2, "west": math.pi, "south": -math.pi / 2}
ROADS = {"straight": 0.0, "left": 1 / 40, "right": -1 / 40}


def pose(
    east: float, north: float, yaw: float, *, speed: float = 10.0, yaw_rate: float = 0.0
) -> Pose:
    return Pose(east, north, yaw, speed, yaw_rate)


@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("road", ROADS)
def test_left_is_positive_on_every_road_in_every_heading(heading: str, road: str) -> None:
    path = course([(ROADS[road], 40.0)], (100.0, 200.0, HEADINGS[heading]))
    place = path.at(15.0)
    errors = track(path, pose(*point_at(path, 15.0, 0.7), place.yaw + 0.1, yaw_rate=0.05))
    assert errors.lateral == pytest.approx(0.7)
    assert errors.heading == pytest.approx(0.1)
    assert errors.yaw_rate == pytest.approx(0.05 - 10.0 * ROADS[road])
    assert errors.curvature == ROADS[road]
    errors = track(path, pose(*point_at(path, 15.0, -0.7), place.yaw - 0.1))
    assert (errors.lateral, errors.heading) == pytest.approx((-0.7, -0.1))


def test_the_paper_s_formula_holds_on_left_turns_and_is_signed_on_right_ones() -> None:
    for side in (1.0, -1.0):
        path = course([(side / 25.0, 30.0)], (3.0, -4.0, 0.4))
        centre = point_at(path, 0.0, side * 25.0)
        ego = point_at(path, 12.0, 1.3)
        distance = math.hypot(ego[0] - centre[0], ego[1] - centre[1])
        errors = track(path, pose(*ego, 0.0))
        assert errors.lateral == pytest.approx(side * (25.0 - distance))


def test_the_path_is_extrapolated_beyond_both_ends() -> None:
    path = course([(0.0, 10.0), (1 / 20, 10.0)])
    assert track(path, pose(-5.0, 0.3, 0.0)).lateral == pytest.approx(0.3)
    errors = track(path, pose(*point_at(path, 26.0, 0.3), 0.8))
    assert (errors.lateral, errors.heading) == pytest.approx((0.3, 0.0))


class Bends:
    """A path whose curvature grows by `rate` (1/m²), with an error `wrong` (1/m) behind the car."""

    def __init__(self, rate: float, here: float = 0.0, wrong: float = 0.0) -> None:
        self._rate, self._here, self._wrong = rate, here, wrong

    def curvature_at(self, station: float) -> float:
        return self._rate * station + (self._wrong if station < self._here - 1.0 else 0.0)

    def curvatures(self, start: float, step: float, count: int) -> list[float]:
        return [self.curvature_at(start + k * step) for k in range(count)]


@given(
    steps=st.lists(st.floats(0.0, 0.9), min_size=1, max_size=60),
    start=st.floats(-12.0, 1.0),
    step=st.floats(0.05, 1.0),
)
def test_behind_the_car_the_curvature_is_the_one_followed_there(
    steps: list[float], start: float, step: float
) -> None:
    """Regardless of the present trajectory at stations more than a metre behind."""
    rate, behind, driven = 0.01, PathBehind(), 0.0
    for distance in (0.0, *steps):
        driven += distance
        path = Bends(rate, driven, wrong=0.7)
        errors = TrackingErrors(0.0, 0.0, 0.0, rate * driven, path, driven)
        behind.extend(driven, errors)
    errors.behind = behind
    curvatures = errors.curvatures_driven(start, step, 30)
    assert len(curvatures) == 30
    for k, curvature in enumerate(curvatures):
        place = max(driven + start + k * step, 0.0)  # constant before the start
        assert curvature == pytest.approx(rate * place, abs=1.01 * rate * SPACING)
    errors.behind = None
    assert errors.curvatures_driven(start, step, 30) == errors.curvatures_ahead(start, step, 30)
