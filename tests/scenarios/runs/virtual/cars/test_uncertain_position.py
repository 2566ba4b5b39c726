"""Convoys whose receivers state large errors slow down together."""

import pytest

from tests.made.convoys.driven import Driven, driven
from vehicles.messages import Tracking

FLOAT = "gnss.preset=rtk_float"


def slowed(run: Driven, vehicle: str) -> bool:
    return any("uncertain" in one.reason for one in run.of(vehicle, Tracking))


@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ["lane_change", "highway"])
def test_a_convoy_with_float_receivers_slows_without_a_collision(name: str) -> None:
    run = driven(name, FLOAT, "duration_s=20.0", "convoy.vehicles=3")
    assert "collision" not in run.kinds_of_events()
    for vehicle in ("v1", "v2", "v3"):
        assert slowed(run, vehicle)
        assert 13.0 < run.speeds(vehicle)[-1] < 19.0
        assert min(run.speeds(vehicle)) > 3.0


def test_a_single_uncertain_follower_holds_up_those_behind() -> None:
    """At a common speed; the follower behind it keeps its gap."""
    run = driven("lane_change", "duration_s=20.0", f"vehicle.v3.{FLOAT}")
    assert "collision" not in run.kinds_of_events()
    assert [name for name in run.scenario.vehicle_names if slowed(run, name)] == ["v3"]
    last = {name: run.speeds(name)[-1] for name in run.followers}
    assert last["v2"] > 28.0
    assert last["v3"] == pytest.approx(last["v4"], abs=1.5)
    assert last["v4"] < 22.0


@pytest.mark.parametrize("more", [(FLOAT, "control.degradation.reaction=hold"), ()])
def test_a_lead_keeps_its_speed_unless_uncertain_followers_adapt(more: tuple[str, ...]) -> None:
    run = driven("lane_change", "duration_s=8.0", *more)
    assert min(run.speeds("v1")) > 29.0
    assert not slowed(run, "v1")
    if not more:
        assert not any(slowed(run, name) for name in run.followers)
