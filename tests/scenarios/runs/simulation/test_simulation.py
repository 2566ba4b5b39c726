"""Every schedule of faults keeps the invariants, and repeats exactly."""

import pytest

from tests.scenarios.runs.simulation.plan import Plan, draw
from tests.scenarios.runs.simulation.simulate import simulate


@pytest.mark.campaign(15, 10_000)
def test_no_schedule_breaks_an_invariant(campaign: int) -> None:
    for seed in range(campaign):
        plan = draw(seed)
        assert not simulate(plan).broken, plan


@pytest.mark.parametrize("launched", [True, False])
def test_a_run_without_faults_is_completed(*, launched: bool) -> None:
    starts = () if launched else (("recorder", 0), ("v1", 10**8), ("v2", 2 * 10**8))
    run = simulate(Plan(seed=0, launched=launched, starts=starts))
    assert not run.broken
    assert "outcome: completed" in run.states


@pytest.mark.parametrize("seed", [3, 11])
def test_a_seed_repeats_exactly(seed: int) -> None:
    assert simulate(draw(seed)) == simulate(draw(seed))
