"""Convoys that keep their gaps almost without messages, and whose lead brakes."""

from itertools import pairwise

import pytest

from scenarios.definition.scenario import scenario_from_text
from tests.made.convoys.driven import Driven, driven
from vehicles.car.tyres import GRAVITY
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.situation import stopping_distance
from vehicles.driver.speed_guard import TYRES_USED
from vehicles.messages import Command, TruePose

FAST, SLOW, BRAKES_AT_S = 25.0, 5.0, 6.0
LENGTH = 4.93
CONVOY = """
name = "braking_lead"
duration_s = {duration_s}
[convoy]
vehicles = {vehicles}
[path]
kind = "segments"
segments = [{{ length_m = 1000.0 }}]
[speed]
lead = "profile"
followers = "gap"
profile = [
    {{ at_s = 0.0, speed_mps = 25.0 }}, {{ at_s = 6.0, speed_mps = 25.0 }},
    {{ at_s = {slow_at_s}, speed_mps = 5.0 }},
]
[links]
loss_ratio = {loss}
"""


def spacings(run: Driven) -> list[list[float]]:
    """Distances (m) of each vehicle to the one ahead, along the straight road to the east."""
    east = [[one.east_m for one in run.of(name, TruePose)] for name in run.scenario.vehicle_names]
    return [
        [one - other for one, other in zip(ahead, behind, strict=True)]
        for ahead, behind in pairwise(east)
    ]


def test_physics_allows_this_convoy_to_be_safe_whatever_is_lost() -> None:
    # Both cars brake with full force, the lead immediately. Without messages the next car may react
    # later by this time.
    emergency = DegradationSettings().emergency
    gap = 8.0 + 0.5 * FAST - LENGTH
    lead_stands_after = FAST**2 / (2.0 * emergency.deceleration)
    left = gap + lead_stands_after - stopping_distance(FAST, 0.0, emergency)
    assert 0.37 < left / FAST < 0.38


@pytest.mark.campaign(0, 200)
@pytest.mark.parametrize("braking", [2.5, 6.0])
@pytest.mark.parametrize("loss", [0.8, 0.9, 0.97])
def test_none_of_eight_vehicles_collides(loss: float, braking: float, case: int) -> None:
    assert_nobody_drives_into_anybody(loss, braking, 8, case)


@pytest.mark.campaign(1, 200)
@pytest.mark.spread(2)
@pytest.mark.parametrize("braking", [2.5, 6.0])
@pytest.mark.parametrize("loss", [0.8, 0.9, 0.97])
def test_no_vehicle_collides(loss: float, braking: float, case: int) -> None:
    assert_nobody_drives_into_anybody(loss, braking, 4, case)


def assert_nobody_drives_into_anybody(
    loss: float, braking: float, vehicles: int, case: int
) -> None:
    slow_at_s = BRAKES_AT_S + (FAST - SLOW) / braking
    text = CONVOY.format(
        duration_s=slow_at_s + 4.0, vehicles=vehicles, slow_at_s=slow_at_s, loss=loss
    )
    run = driven(scenario_from_text(text, seed=case + 1))
    assert len(run.scenario.vehicle_names) == vehicles
    assert min(map(min, spacings(run))) - LENGTH > 0.5
    for name in run.followers:
        emergency = min(one.acceleration_mps2 for one in run.of(name, Command))
        assert emergency >= -TYRES_USED * 0.9 * GRAVITY - 1e-9


CHAIN = """
name = "chain"
duration_s = {duration_s}
[convoy]
vehicles = 5
{gap}
[path]
kind = "segments"
segments = [{{ length_m = 1500.0 }}]
[speed]
lead = "profile"
followers = "{followers}"
profile = [
    {{ at_s = 0.0, speed_mps = 25.0 }}, {{ at_s = 10.0, speed_mps = 25.0 }},
    {{ at_s = 14.0, speed_mps = 15.0 }}, {{ at_s = 20.0, speed_mps = 15.0 }},
    {{ at_s = 27.0, speed_mps = 25.0 }},
]
[speed.gap]
standstill_m = 7.0
headway_s = 0.0
{links}
"""


@pytest.mark.spread(1)
@pytest.mark.parametrize(("followers", "gap"), [("gap", 12.0), ("same", 15.0)])
def test_gaps_do_not_grow_along_predecessor_only_vehicles(followers: str, gap: float) -> None:
    silence = 'outages = [{ kind = "window", from_s = 5.0, to_s = 1000.0 }]'
    links = "".join(
        f'[[link]]\nsender = "v1"\nreceiver = "v{place}"\n{silence}\n' for place in range(3, 6)
    )
    first = f"gap_m = {gap}" if followers == "same" else ""
    text = CHAIN.format(duration_s=32.0, gap=first, followers=followers, links=links)
    gaps = spacings(driven(scenario_from_text(text)))
    assert min(map(min, gaps)) > gap - 1.5
    # The second vehicle receives the lead; others open to the headway that is stable without it.
    opened = 0.35 * FAST if followers == "gap" else 0.0
    for one in gaps[1:]:
        assert max(one) < gap + opened + 0.5
