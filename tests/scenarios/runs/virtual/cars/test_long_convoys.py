"""The error against the road along sixteen cars does not grow."""

import pytest

from scenarios.runs.virtual.unlogged_run import run_unlogged
from tests.made.scenarios.convoy_roads import ROADS, convoy_on_road

GROWTH_M = 0.02


def road_errors(name: str, seed: int, *overrides: str) -> list[float]:
    """Largest error (m) of each of sixteen vehicles against the road."""
    summary = run_unlogged(convoy_on_road(name, seed, 16, *overrides))
    return [row.road_error_m_max or 0.0 for row in summary.vehicles]


@pytest.mark.campaign(1, 5)
@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ROADS)
def test_the_last_of_sixteen_cars_is_hardly_further_off_than_the_second(
    name: str, campaign: int
) -> None:
    errors = [road_errors(name, seed) for seed in range(1, campaign + 1)]
    second, last = (max(of_seed[place] for of_seed in errors) for place in (1, -1))
    assert last <= second + GROWTH_M, errors


def test_it_grows_where_the_offset_of_the_predecessor_is_not_used() -> None:
    errors = road_errors(ROADS[0], 1, "control.degradation.predecessor_path=intended")
    assert errors[-1] > errors[1] + GROWTH_M, errors
