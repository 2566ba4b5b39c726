"""The simulation finds protocol bugs that are planted."""

import pytest

from tests.scenarios.runs.simulation.plan import draw
from tests.scenarios.runs.simulation.planted import PLANTED
from tests.scenarios.runs.simulation.simulate import simulate

QUICK = ("missing_messages_are_not_counted", "the_last_messages_are_dropped")
"""Found within a few seeds; the others are planted with `--campaign`."""
MOST_SEEDS = 1000


@pytest.mark.campaign(len(QUICK), len(PLANTED))
def test_a_planted_bug_is_found(case: int, monkeypatch: pytest.MonkeyPatch) -> None:
    name = [*QUICK, *(name for name in PLANTED if name not in QUICK)][case]
    PLANTED[name](monkeypatch)
    assert any(simulate(draw(seed)).broken for seed in range(MOST_SEEDS))
