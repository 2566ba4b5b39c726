"""A vehicle that hears of a start that lies behind: too late, or with a clock that is wrong."""

import time

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.assembly.vehicle import VehicleBuilder
from scenarios.runs.processes.clock_offset import answer_for_clock
from scenarios.runs.processes.membership import VEHICLE, Fingerprint, Membership
from scenarios.runs.processes.vehicle import RunOffError, VehicleProcess
from scenarios.runs.stop import Stop
from transport.bus.memory_bus import MemoryBus, MemoryNetwork
from transport.codec import encode
from transport.topics import CONDUCTOR, TOPICS, key
from vehicles.messages import RunStart
from vehicles.schedule import SECOND


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("lane_change", ["duration_s=5"])


@pytest.mark.parametrize(
    ("ahead_s", "started_s", "why"),
    [
        (0.0, -3.0, "run mine had started before this vehicle joined"),
        (
            10.0,
            0.5,
            "run mine is off for this vehicle: its clock is 10.0 s ahead of the recorder's",
        ),
        (10.0, -3.0, "run mine had started before this vehicle joined"),
    ],
    ids=["late", "ahead", "late and ahead"],
)
def test_a_start_that_lies_behind_is_told_apart_from_a_clock_ahead(
    scenario: Scenario, ahead_s: float, started_s: float, why: str
) -> None:
    network, stop = MemoryNetwork(), Stop()
    recorder, bus = MemoryBus(network), MemoryBus(network)

    def recorders_now() -> int:
        return time.time_ns() - round(ahead_s * SECOND)

    answer_for_clock(recorder, CONDUCTOR, recorders_now)
    membership = Membership(bus, "mine", VEHICLE, "v2", Fingerprint.of(scenario))
    vehicle = VehicleProcess(VehicleBuilder(scenario, "v2"), bus, membership, stop)
    start_at = recorders_now() + round(started_s * SECOND)
    start = RunStart(vehicle=CONDUCTOR, seq=0, start_at_ns=start_at, run_id="x")
    recorder.publish(key(CONDUCTOR, TOPICS["start"]), encode(start))
    with pytest.raises(RunOffError, match=f"^{why}$"):
        vehicle.await_start(lambda _: None, 1.0)
