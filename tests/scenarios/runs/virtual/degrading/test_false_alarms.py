"""Over a link that loses in bursts, sources are lost as often as its law has it, without flapping.

`pytest --campaign` drives twenty times as much.
"""

from itertools import pairwise

import pytest

from scenarios.definition.scenario import scenario_from_text
from tests.made.convoys.driven import driven
from vehicles.messages import Tracking
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
    run = driven(scenario)
    alarms = [one.false_alarms for one in run.summary.links if one.receiver != "v1"]
    # 20 messages a second of which 0.6 pass, each before a burst with 1/6; 0.75 that one goes on.
    predicted = 3.0 * scenario.duration_s * 20.0 * 0.6 / 6.0 * 0.75**9
    counted = sum(one.counted or 0 for one in alarms)
    assert len(alarms) == 3
    assert predicted > 25.0
    assert abs(counted - predicted) < 3.5 * predicted**0.5  # they come nearly one by one
    for name in scenario.vehicle_names[1:]:
        tracking = run.of(name, Tracking)
        entered: dict[str, int] = {}
        changes = [one for before, one in pairwise(tracking) if one.mode != before.mode]
        for one in (one for one in changes if one.mode == "composite"):  # after a probation
            since = (one.decided_at_ns - entered.get(one.mode, 0)) / SECOND
            assert since >= PROBATION_S, f"{name} to {one.mode} again after {since:.2f} s"
            entered[one.mode] = one.decided_at_ns
            assert one.reason
