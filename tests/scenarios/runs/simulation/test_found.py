"""Schedules under which a run once was wrong without a word."""

from pathlib import Path

import pytest

from tests.scenarios.runs.simulation.invariants import Aftermath, broken
from tests.scenarios.runs.simulation.network import NetworkSettings
from tests.scenarios.runs.simulation.plan import Plan
from tests.scenarios.runs.simulation.shrinking import simulate
from tests.scenarios.runs.simulation.world import World
from vehicles.messages import Change
from vehicles.schedule import SECOND

BY_HAND = (("recorder", 0), ("v1", 0), ("v2", 0))
END = 180 * SECOND // 100
"""Shortly before the end of a run of a second that was started by hand at once."""


def test_a_vehicle_stopped_before_the_end_is_announced_does_not_report_success() -> None:
    faults = (("pause", 2 * SECOND, "recorder", 3 * SECOND), ("stop", 3 * SECOND, "v1", 15))
    run = simulate(Plan(seed=0, launched=False, starts=BY_HAND, faults=faults))
    assert not run.broken
    assert "vehicle ended with 143" in run.states


@pytest.mark.parametrize("away_s", [1, 4])
def test_vehicles_learn_of_the_end_after_an_outage_of_the_router(away_s: int) -> None:
    for tenths in range(6):
        faults = (("restart router", END + tenths * SECOND // 50, away_s * SECOND),)
        run = simulate(Plan(seed=0, launched=False, starts=BY_HAND, faults=faults))
        assert not run.broken
        assert "vehicle ended with 1" not in run.states


def test_a_change_confirmed_before_an_outage_is_in_the_log(tmp_path: Path) -> None:
    plan = Plan(
        seed=0,
        launched=False,
        starts=BY_HAND,
        network=NetworkSettings(lease=SECOND),
        faults=(
            ("change", SECOND, "stall", "v1"),
            ("freeze router", 105 * SECOND // 100, 2 * SECOND),
        ),
    )
    world = World(plan, tmp_path)
    world.run()
    run = Aftermath(world)
    assert not broken(run)
    (request,) = world.requests
    assert request.answers is not None
    assert all(each.answer and each.answer.does for each in request.answers)
    assert [change.kind for change in run.of_kind(Change)] == ["stall"]


def test_messages_that_arrive_after_the_last_tick_are_not_in_flight(tmp_path: Path) -> None:
    faults = (("cut", 9 * SECOND // 10, "v2", 11 * SECOND // 10),)
    world = World(Plan(seed=0, launched=False, starts=BY_HAND, faults=faults), tmp_path)
    world.run()
    run = Aftermath(world)
    assert not broken(run)
    assert run.summary is not None
    (link,) = run.summary.links
    assert link.in_flight <= 1
    assert sum(link.not_arrived.values()) >= 8
