"""Convoys whose receivers state large errors slow down together."""

from collections import defaultdict

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.observer import Kinds
from scenarios.runs.virtual import run_unlogged
from vehicles.messages import Message, Tracking, TruePose


class Seen:
    """Speeds (m/s) and reasons by vehicle."""

    kinds: Kinds = frozenset((TruePose, Tracking))

    def __init__(self) -> None:
        self.speeds: defaultdict[str, list[float]] = defaultdict(list)
        self.reasons: defaultdict[str, list[str]] = defaultdict(list)

    def listen(self, now: int, message: Message) -> None:  # noqa: ARG002
        if isinstance(message, TruePose):
            self.speeds[message.vehicle].append(message.speed_mps)
        elif isinstance(message, Tracking):
            self.reasons[message.vehicle].append(message.reason)

    def slowed(self, vehicle: str) -> bool:
        return any("uncertain" in reason for reason in self.reasons[vehicle])


def run(name: str, *overrides: str) -> tuple[Seen, list[str]]:
    """Speeds and reasons of a run, and the kinds of its events."""
    seen = Seen()
    summary = run_unlogged(load_scenario(name, list(overrides)), [seen])
    return seen, [event.kind for event in summary.events]


FLOAT = "gnss.preset=rtk_float"


@pytest.mark.spread(1)
@pytest.mark.parametrize("name", ["lane_change", "highway"])
def test_a_convoy_with_float_receivers_slows_without_a_collision(name: str) -> None:
    seen, events = run(name, FLOAT, "duration_s=20.0", "convoy.vehicles=3")
    assert "collision" not in events
    for vehicle, speeds in seen.speeds.items():
        assert seen.slowed(vehicle)
        assert 13.0 < speeds[-1] < 19.0
        assert min(speeds) > 3.0


def test_a_single_uncertain_follower_holds_up_those_behind() -> None:
    """At a common speed; the follower behind it keeps its gap."""
    seen, events = run("lane_change", "duration_s=20.0", f"vehicle.v3.{FLOAT}")
    assert "collision" not in events
    assert [seen.slowed(vehicle) for vehicle in ("v1", "v2", "v3", "v4")] == [
        False, False, True, False
    ]  # fmt: skip
    assert seen.speeds["v2"][-1] > 28.0
    assert seen.speeds["v3"][-1] == pytest.approx(seen.speeds["v4"][-1], abs=1.5)
    assert seen.speeds["v4"][-1] < 22.0


def test_gaps_widen_with_the_uncertainty_of_both_positions() -> None:
    """Without it there are two collisions: the receivers are off by more than half the gap."""
    _, events = run("church_lot", "duration_s=18.0", "gnss.preset=single")
    assert "collision" not in events


def test_a_lead_keeps_its_speed_if_its_followers_cannot_adapt() -> None:
    seen, _ = run("lane_change", "duration_s=8.0", FLOAT, "control.degradation.reaction=hold")
    assert min(seen.speeds["v1"]) > 29.0
    assert not seen.slowed("v1")


def test_usual_receivers_never_slow_a_car() -> None:
    seen, _ = run("lane_change", "duration_s=8.0")
    assert not any(seen.slowed(vehicle) for vehicle in seen.speeds)
