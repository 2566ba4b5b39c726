"""Each shipped scenario on each shipped channel with 3 to 8 vehicles, three seeds each.

`pytest --campaign` simulates all of them. The scenarios of the paper drive as in the paper.
"""

from itertools import product
from random import Random

import pytest

from scenarios.definition.channel.presets import presets
from scenarios.definition.scenario import library, load_scenario
from tests.made.convoys.cuts import simulated

SCENARIOS = [name for name in library() if not name.startswith("paper")]
CASES = list(product(SCENARIOS, presets(), range(3, 9), (1, 2, 3)))
Random(1).shuffle(CASES)  # the few that run by default differ in all other respects
CASES.sort(key=lambda case: case[2] > 3)


@pytest.mark.campaign(1, len(CASES))
def test_a_convoy_drives_on_a_shipped_channel(case: int) -> None:
    """No collision, no departure from the lane that was avoidable."""
    name, preset, vehicles, seed = CASES[case]
    overrides = (f"convoy.vehicles={vehicles}", f"links.preset={preset}")
    scenario = load_scenario(name, overrides, seed)
    cars = simulated(scenario).values()
    assert sum(car.collisions for car in cars) == 0
    assert sum(car.departures_avoidable() for car in cars) == 0
