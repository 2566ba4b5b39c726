"""Answers of a vehicle to change requests, and their effects."""

from math import ceil

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.cli import change_requests
from scenarios.definition.changes import ChangeRequest
from scenarios.definition.scenario import load_scenario
from scenarios.runs.end_confirmation import addressed
from scenarios.runs.live_control import Confirmation, LiveControl, first_instant
from scenarios.runs.node.outbox import PendingChanges
from scenarios.runs.processes.membership import RECORDER, VEHICLE, Fingerprint
from transport.bus.bus import MemoryBus, MemoryNetwork
from transport.clock import SystemTime
from transport.topics import control_key
from vehicles.schedule import SECOND, nanoseconds

START = 1_790_000_000_123_456_789
PERIOD = SECOND // 50
DURATION_S = 5.0
RUN_ID = "recorder"


class Vehicle:
    """A vehicle that answers requests, with a clock that stands still at `now` (ns)."""

    def __init__(self, name: str, now: int, *overrides: str) -> None:
        scenario = load_scenario("lane_change", [f"duration_s={DURATION_S}", *overrides])
        self.pending_changes = PendingChanges()
        self.control = LiveControl(scenario, name, lambda: now)

    def begun(self) -> "Vehicle":
        self.control.begin(START, self.pending_changes)
        return self

    def ask(self, at_s: float | None = None, **entry: object) -> Confirmation:
        return self.control.answer(ChangeRequest(entry, at_s).text)

    def confirm(self, at_s: float) -> Confirmation:
        return self.control.answer(ChangeRequest({}, at_s, confirms=True).text)


@given(st.integers(0, 10**12), st.sampled_from([5.0, 30.0, 50.0, 333.0, 500.0]))
def test_it_takes_effect_at_the_first_tick_two_periods_ahead(since: int, rate_hz: float) -> None:
    at = first_instant(START + since, START, rate_hz)
    k = ceil((since / SECOND) * rate_hz)
    near = [START + round(one * SECOND / rate_hz) for one in range(max(k - 2, 0), k + 5)]
    assert at == min(one for one in near if one >= START + since + round(2 * SECOND / rate_hz))


@pytest.mark.parametrize("wanted_s", [0.16, 0.18, 0.21, 1.0])
def test_an_instant_can_be_requested(wanted_s: float) -> None:
    vehicle = Vehicle("v3", START + 7 * PERIOD).begun()
    assert vehicle.ask(wanted_s, kind="heal") == Confirmation("v3", wanted_s, "as in the scenario")
    other = vehicle.ask(wanted_s, kind="cut")  # one change at an instant
    assert other.can_be_later
    assert wanted_s < other.from_s < wanted_s + 0.1


@pytest.mark.parametrize("wanted_s", [0.0, 0.14, 25.0])
def test_an_impossible_instant_is_refused_with_a_possible_one(wanted_s: float) -> None:
    vehicle = Vehicle("v3", START + 7 * PERIOD, "duration_s=30").begun()
    refused = vehicle.ask(wanted_s, kind="heal")
    assert refused.can_be_later
    assert refused.from_s == 0.18


@pytest.mark.parametrize("takes_s", [(0.0, 0.0, 0.0), (0.0, 0.25, 0.01), (0.9, 0.0, 0.3)])
def test_all_vehicles_make_the_same_changes_in_the_same_order(
    takes_s: tuple[float, ...],
) -> None:
    """Commands within one tick, and vehicles that answer slowly."""
    network, clock = MemoryNetwork(), [START]
    system = SystemTime(monotonic=lambda: clock[0])
    scenario = load_scenario("lane_change", ["duration_s=35"])
    pending = []
    for k, takes in enumerate(takes_s, start=2):

        def read(takes: float = takes) -> int:
            clock[0] += nanoseconds(takes)
            return clock[0]

        control = LiveControl(scenario, f"v{k}", read)
        pending.append(PendingChanges())
        control.begin(START, pending[-1])
        bus = MemoryBus(network)
        bus.announce(VEHICLE, f"v{k}", "run")
        control.listen(bus, lambda: RUN_ID)
    MemoryBus(network).announce(RECORDER, RUN_ID, Fingerprint.of(scenario).chunk)
    kinds = ["cut", "heal", "cut"]
    for kind in kinds:
        answers = change_requests.request_change(MemoryBus(network), "run", {"kind": kind}, system)
        assert all(each.answer and each.answer.does for each in answers), answers
    made = [[(due.at, due.change.kind) for due in one.pending] for one in pending]
    assert made[0] == made[1] == made[2]
    assert [kind for _, kind in made[0]] == kinds
    assert len({at for at, _ in made[0]}) == len(kinds)


def test_a_change_that_one_vehicle_refuses_is_made_by_none() -> None:
    network, pending = MemoryNetwork(), PendingChanges()
    scenario = load_scenario("lane_change", ["duration_s=35"])
    fingerprint = Fingerprint.of(scenario).chunk
    MemoryBus(network).announce(RECORDER, RUN_ID, fingerprint)
    for name in ("v2", "v3"):
        bus, control = MemoryBus(network), LiveControl(scenario, name, lambda: START)
        bus.announce(VEHICLE, name, fingerprint)
        control.listen(bus, lambda: RUN_ID)
        if name == "v3":  # v2 has not started yet
            control.begin(START, pending)
    bus = MemoryBus(network)
    answers = change_requests.request_change(bus, "run", {"kind": "cut"})
    refused, other = (each.answer for each in answers)
    assert refused is not None
    assert refused.refused
    assert other == Confirmation("v3")
    assert pending.pending == ()


@pytest.mark.parametrize(
    ("name", "entry", "does"),
    [
        ("v1", {"kind": "cut"}, "cut"),
        ("v2", {"kind": "cut"}, "cut"),
        ("v2", {"kind": "cut", "receiver": "v3"}, ""),
        ("v3", {"kind": "cut", "sender": "predecessor"}, "cut"),
        ("v3", {"kind": "link", "loss_ratio": 0.5}, "loss_ratio 0.5"),
        ("v3", {"kind": "stall", "vehicle": "v3", "for_s": 0.5}, "stall for 0.5 s"),
        ("v2", {"kind": "stall", "vehicle": "v3", "for_s": 0.5}, ""),
        ("v1", {"kind": "speed", "speed_mps": 10.0}, "speed speed_mps 10.0, "
         "acceleration_mps2 1.5"),
    ],
)  # fmt: skip
def test_each_vehicle_carries_out_the_changes_that_concern_it(
    name: str, entry: dict[str, object], does: str
) -> None:
    vehicle = Vehicle(name, START).begun()
    promised = vehicle.control.answer(ChangeRequest(entry).text)
    assert promised.does == does
    vehicle.confirm(promised.from_s)
    assert len(vehicle.pending_changes.take(START + SECOND)) == bool(does)


REFUSED = [
    (b"", "no JSON: Expecting value: line 1 column 1 (char 0)"),
    (b"\xff\xfe", None),
    (b"[" * 100_000, "given 100000 bytes, allowed 4096"),
    (b"[" * 4000, None),
    (b"[1]", "allowed one entry of [[change]], as JSON"),
    (b'{"kind": "sever"}', 'kind: given "sever", allowed "link", "cut", "heal", "gnss", "stall", '
     '"crash", "leave", "join" or "speed"'),
    (b'{"kind": "cut", "sender": "v9"}', 'sender: given "v9", allowed "v1", "v2", "v3", "v4", '
     '"lead", "predecessor", "follower", "*"'),
    (b'{"kind": "cut", "sender": "v4", "receiver": "v1"}', "from v4 to v1: no such link, "
     "v1 receives from v2, v3"),
    (b'{"kind": "link", "loss_ratio": NaN}', "loss_ratio: given nan, allowed a finite number"),
    (b'{"kind": "link"}', "changes nothing, allowed at least one of loss_ratio, latency_ms, "
     "jitter_ms"),
    (b'{"kind": "stall", "vehicle": "v3"}', "for_s: missing"),
    (b'{"kind": "stall", "vehicle": "v7", "for_s": 1}', 'vehicle: given "v7", allowed v1, v2, v3, '
     "v4"),
]  # fmt: skip


@pytest.mark.parametrize(("question", "line"), REFUSED)
def test_an_invalid_change_is_refused_in_a_line(question: bytes, line: str | None) -> None:
    vehicle = Vehicle("v3", START).begun()
    reported = vehicle.control.answer(question)
    assert len(reported.refused) == 1
    assert reported.does == ""
    assert line is None or reported.refused == (line,)
    assert vehicle.pending_changes.take(START + 10 * SECOND) == []
    assert Confirmation.of(reported.text) == reported


def test_it_answers_over_the_bus() -> None:
    network = MemoryNetwork()
    vehicle = Vehicle("v3", START).begun()
    vehicle.control.listen(MemoryBus(network), lambda: RUN_ID)
    request = addressed(RUN_ID, ChangeRequest({"kind": "heal"}).text)
    assert Confirmation.of(asked(network, request)).does == "as in the scenario"


def asked(network: MemoryNetwork, request: bytes) -> bytes:
    return MemoryBus(network).query(control_key("v3"), 1.0, request) or b""


@pytest.mark.parametrize("run_id", ["recorder", ""])
def test_a_request_to_another_run_gets_no_answer_and_changes_nothing(run_id: str) -> None:
    """Also before the vehicle knows its recorder."""
    network = MemoryNetwork()
    vehicle = Vehicle("v3", START + SECOND).begun()
    vehicle.control.listen(MemoryBus(network), lambda: run_id)
    text = ChangeRequest({"kind": "cut"}, 2.0).text
    for request in (text, addressed("earlier", text), addressed("", text)):
        assert asked(network, request) == b""
    assert vehicle.confirm(2.0).refused  # nothing was promised


def test_a_replayed_request_changes_nothing_again() -> None:
    network = MemoryNetwork()
    vehicle = Vehicle("v3", START + SECOND).begun()
    vehicle.control.listen(MemoryBus(network), lambda: RUN_ID)
    requests = [
        addressed(RUN_ID, ChangeRequest({"kind": "cut"}, 2.0).text),
        addressed(RUN_ID, ChangeRequest({}, 2.0, confirms=True).text),
    ]
    for request in (*requests, *requests):
        asked(network, request)
    assert len(vehicle.pending_changes.pending) == 1
