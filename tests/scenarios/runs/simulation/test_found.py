"""Schedules under which a run once was wrong without a word."""

from pathlib import Path

import pytest

from tests.scenarios.runs.simulation.invariants import Aftermath, broken
from tests.scenarios.runs.simulation.network import NetworkSettings
from tests.scenarios.runs.simulation.plan import Fault, Plan
from tests.scenarios.runs.simulation.simulate import simulate
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


@pytest.mark.parametrize(("cut_s", "exit_code"), [(3, 0), (8, 1)])
def test_a_vehicle_cut_off_after_its_final_counters_is_awaited_or_named(
    cut_s: int, exit_code: int
) -> None:
    plan = Plan(
        seed=0,
        launched=False,
        starts=BY_HAND,
        network=NetworkSettings(lease=SECOND * 2 // 3),
        faults=(("cut", 195 * SECOND // 100, "v2", cut_s * SECOND),),
    )
    run = simulate(plan)
    assert not run.broken
    assert "outcome: completed" in run.states
    assert ("vehicle ended with 1" in run.states) == bool(exit_code)
    named = "printed: error: the run is completed, but V did not confirm the end"
    assert (named in run.states) == bool(exit_code)


def test_changes_are_confirmed_at_a_round_trip_of_more_than_a_second(tmp_path: Path) -> None:
    plan = Plan(
        seed=0,
        launched=False,
        duration_s=6.5,
        starts=BY_HAND,
        network=NetworkSettings(delay=3 * SECOND // 10),
        variant=("convoy.clock_uncertainty_ms_max=900",),
        faults=(("change", 6 * SECOND, "stall", "v1"),),
    )
    world = World(plan, tmp_path)
    world.run()
    (request,) = world.requests
    assert request.answers is not None
    assert [bool(each.answer and each.answer.does) for each in request.answers] == [True]


@pytest.mark.parametrize("full_at", [8, 12, 15])
@pytest.mark.parametrize("faults", [(), (("stop", 13 * SECOND // 10, "recorder", 15),)])
def test_a_full_disk_is_reported_by_all_processes(
    full_at: int, faults: tuple[Fault, ...], tmp_path: Path
) -> None:
    """Writes 11 to 15 complete the log and write the summary."""
    full_at -= 4 * len(faults)  # it ends earlier
    plan = Plan(
        seed=0, launched=False, starts=BY_HAND, full_at=full_at, disk_error=28, faults=faults
    )
    world = World(plan, tmp_path)
    world.run()
    assert world.disk.has_failed
    assert any("No space left" in line for line in world.printed)
    assert not any(process.exitcode == 0 for process in world.processes)
    assert not broken(Aftermath(world))
