"""Over a link that loses in bursts, sources are lost as often as its law has it, without flapping.

`pytest --campaign` drives twenty times as much.
"""

from itertools import pairwise

import pytest

from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import run_unlogged
from vehicles.messages import Message, Tracking
from vehicles.schedule import SECOND

PROBATION_S = 0.5
SCENARIO = """
extends = "lane_change"
name = "bursts"
duration_s = 60.0
[convoy]
vehicles = 3
[speed]
set_mps = 15.0
[path]
kind = "segments"
segments = [{ length_m = 3000.0 }]
[links]
loss = { kind = "gilbert_elliott", loss_ratio = 0.4, burst_messages_mean = 4.0 }
[control.degradation]
lost_s_max = 0.5
"""


@pytest.mark.campaign(1, 20)
def test_the_number_of_alarms_follows_the_law_of_the_link(case: int) -> None:
    scenario = scenario_from_text(SCENARIO, seed=case + 1)
    results: list[Message] = []
    keep = OnMessage(lambda _, message: results.append(message), frozenset({Tracking}))
    summary = run_unlogged(scenario, [keep])
    alarms = [one.false_alarms for one in summary.links if one.receiver != "v1"]
    # 20 messages a second of which 0.6 pass, each before a burst with 1/6; 0.75 that one goes on.
    predicted = 3.0 * scenario.duration_s * 20.0 * 0.6 / 6.0 * 0.75**9
    counted = sum(one.counted or 0 for one in alarms)
    assert len(alarms) == 3
    assert predicted > 25.0
    assert abs(counted - predicted) < 3.5 * predicted**0.5  # they come nearly one by one
    for name in scenario.vehicle_names[1:]:
        tracking = [one for one in results if isinstance(one, Tracking) and one.vehicle == name]
        entered: dict[str, int] = {}
        changes = [one for before, one in pairwise(tracking) if one.mode != before.mode]
        for one in (one for one in changes if one.mode == "composite"):  # after a probation
            since = (one.decided_at_ns - entered.get(one.mode, 0)) / SECOND
            assert since >= PROBATION_S, f"{name} to {one.mode} again after {since:.2f} s"
            entered[one.mode] = one.decided_at_ns
            assert one.reason


def test_delays_in_order_are_no_stop_of_a_predecessor() -> None:
    """Delays of 0 to 300 ms without losses: announced stops are received late."""
    straight = "path={kind='segments', segments=[{length_m=800.0}]}", "convoy.gap_m=13.0"
    law = "speed.set_mps=20", "speed.followers='gap'", "control.longitudinal='cacc'"
    delay = "links.delay={kind='uniform', delay_ms_max=300, order='in_order'}"
    sets = [*straight, *law, delay, "convoy.vehicles=4", "duration_s=15"]
    result = run_unlogged(load_scenario("lane_change", sets))
    for car in result.vehicles[1:]:
        assert car.true_gap_m_min is not None
        assert car.true_gap_m_max is not None
        assert car.true_gap_m_max - car.true_gap_m_min < 2.0
