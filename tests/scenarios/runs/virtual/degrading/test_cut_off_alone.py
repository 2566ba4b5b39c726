"""One vehicle is cut off alone and stops; the vehicle behind it must not hit it."""

from random import Random

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.virtual import run_unlogged
from tests.made.convoys.speed_runs import drive
from vehicles.driver.sources import Sources


def cut_off(*more: str, vehicle: str = "v3", for_s: float = 4.2) -> list[str]:
    """Cut `vehicle` off the convoy, both directions, and restore its links."""
    cut = f"kind='cut', at_s=3.8, for_s={for_s}"
    change = f"change=[{{{cut}, sender='{vehicle}'}}, {{{cut}, receiver='{vehicle}'}}]"
    return ["duration_s=15", change, *more]


def collisions(summary: RunSummary) -> int:
    return sum(event.kind == "collision" for event in summary.events)


@pytest.mark.parametrize(("vehicle", "gap_m"), [("v2", 3.0), ("v3", 10.0)])
def test_a_vehicle_that_is_cut_off_alone_is_not_hit(vehicle: str, gap_m: float) -> None:
    overrides = cut_off(f"convoy.gap_m={gap_m}", vehicle=vehicle)
    summary = run_unlogged(load_scenario("lane_change", overrides))
    assert "stop" in summary.vehicles[int(vehicle[1:]) - 1].ticks_by_mode
    assert collisions(summary) == 0


@pytest.mark.campaign(1, 200)
def test_random_cuts_of_one_vehicle_or_link_end_without_a_collision(case: int) -> None:
    chance = Random(case)
    place = chance.randint(2, 4)
    kinds = [f"receiver='v{place}'", f"sender='v{place - 1}', receiver='v{place}'"]
    if place < 4:
        kinds += [f"sender='v{place}'", f"sender='v{place}'}}, {{CUT, receiver='v{place}'"]
    speed, gap_m = chance.uniform(10.0, 33.0), chance.choice([3.0, 8.0, 20.0])
    headway_s = chance.choice([0.0, 0.3, 0.5])
    at_s, for_s = chance.uniform(1.0, 12.0), chance.uniform(0.2, 8.0)
    cut = f"kind='cut', at_s={at_s:.3f}, for_s={for_s:.3f}"
    change = f"{{CUT, {chance.choice(kinds)}}}".replace("CUT", cut)
    overrides = [
        f"duration_s={min(at_s + for_s + 12.0, 1050.0 / speed):.1f}",
        f"speed.set_mps={speed:.2f}",
        f"convoy.gap_m={gap_m + headway_s * speed:.3f}",
        f"speed.followers={chance.choice(['same', 'gap'])}",
        f"speed.gap.standstill_m={gap_m}",
        f"speed.gap.headway_s={headway_s}",
        f"links.latency_ms={chance.choice([20, 100])}",
        f"links.loss_ratio={chance.choice([0.0, 0.0, 0.2])}",
        f"change=[{change}]",
    ]
    assert collisions(run_unlogged(load_scenario("lane_change", overrides, case + 1))) == 0


def test_if_no_stop_were_assumed_it_would_be_hit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Sources, "stops_at", lambda *_: 0)
    assert collisions(run_unlogged(load_scenario("lane_change", cut_off()))) > 0


def test_a_short_silence_costs_little_speed() -> None:
    """Half a second of messages from v3 to v4 is lost, of which v4 brakes for a tenth."""
    cut = "change=[{kind='cut', at_s=3.8, for_s=0.5, sender='v3', receiver='v4'}]"
    driven = drive(load_scenario("lane_change", ["duration_s=6", cut]))
    assert min(pose.speed_mps for pose in driven.truth["v4"]) > 27.5
