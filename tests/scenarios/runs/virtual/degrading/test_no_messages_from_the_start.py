"""Cars with hardly any messages yet: a follower without a first message stops, too."""

from math import isnan

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import run_unlogged
from tests.made.convoys.speed_runs import Driven
from vehicles.driver.settings import DegradationSettings
from vehicles.driver.source import Reception
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

LOST_S = Reception(0.05, DegradationSettings()).lost_after
"""A source of twenty messages a second is lost after such a silence at the start."""
DARK_S = 8.0


def convoy(vehicles: int, gap_m: float, *more: str, seed: int = 1) -> Scenario:
    requested = (f"convoy.vehicles={vehicles}", f"convoy.gap_m={gap_m}", *more)
    return load_scenario("lane_change", requested, seed)


def summary(vehicles: int, gap_m: float, *more: str, seed: int = 1) -> RunSummary:
    return run_unlogged(convoy(vehicles, gap_m, *more, seed=seed))


def collisions(run: RunSummary) -> int:
    return sum(event.kind == "collision" for event in run.events)


def speed_at(driven: Driven, scenario: Scenario, vehicle: str, seconds: float) -> float:
    def off(one: TruePose) -> float:
        return abs(one.true_at_ns - scenario.start_at_ns - seconds * SECOND)

    return min(driven.truth[vehicle], key=off).speed_mps


@pytest.mark.parametrize("gap_m", [3, 10])
def test_vehicles_without_messages_stop_together_and_drive_on_with_them(gap_m: float) -> None:
    dark = f"change=[{{kind='cut', at_s=0, for_s={DARK_S}}}]"
    scenario = convoy(4, gap_m, dark, "duration_s=24")
    driven = Driven()
    run = run_unlogged(scenario, [OnMessage(driven.take)])
    for name in ("v2", "v3", "v4"):
        speeds = [
            speed_at(driven, scenario, name, at) for at in (LOST_S, LOST_S + 1.5, DARK_S, 24.0)
        ]
        assert speeds[0] == pytest.approx(30.0, abs=0.2)
        # 6 m/s² from then on, half a second later at most: the jerk is 12 m/s³.
        assert 30.0 - 6.0 * 1.5 - 0.1 < speeds[1] < 30.0 - 6.0 * 1.2
        assert speeds[2] < 0.05
        assert speeds[3] > 5.0
        assert all(abs(one.steering_rad) < 0.01 for one in driven.truth[name][: int(DARK_S * 50)])
    assert collisions(run) == 0
    assert min(row.true_gap_m_min or 99.0 for row in run.vehicles) > 0.7 * gap_m


@pytest.mark.campaign(1, 100)
@pytest.mark.parametrize("loss", [0.9, 0.95, 0.98])
def test_a_vehicle_that_brakes_without_first_messages_is_not_hit(loss: float, case: int) -> None:
    """Where a convoy begins closer than is safe, and hardly a message comes."""
    own = (f"links.loss_ratio={loss}", "duration_s=8")
    assert collisions(summary(3, 10.07, *own, seed=25 + case)) == 0


def test_a_follower_without_its_predecessor_keeps_away_from_where_it_may_stand() -> None:
    """v3 receives only the lead, v2 nothing: v2 stops without a warning to v3."""
    silent = ("{sender='v1', receiver='v2'}", "{sender='v2', receiver='v3'}")
    links = ",".join(one.replace("}", ", loss_ratio=1.0}") for one in silent)
    run = summary(3, 10.07, f"link=[{links}]", "duration_s=12")
    assert collisions(run) == 0
    assert (run.vehicles[2].true_gap_m_min or 0.0) > 5.0
    assert run.vehicles[2].estimated_gap_m_min is None or isnan(run.vehicles[2].estimated_gap_m_min)


@pytest.mark.spread(2)
@pytest.mark.parametrize("gap_m", [10, 30])
@pytest.mark.parametrize("latency_ms", [400, 700, 1000])
def test_a_latency_is_no_silence(gap_m: float, latency_ms: float) -> None:
    """The first message is waited for as long as a message takes to come, and then some."""
    run = summary(3, gap_m, f"links.latency_ms={latency_ms}", "duration_s=4")
    assert not any("stop" in row.ticks_by_mode for row in run.vehicles)
