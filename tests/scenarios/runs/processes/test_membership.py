"""Joining a run: who is let in, who is refused with which line, and who counts as present."""

import re
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.versions import _module_digest, current_stamp
from scenarios.runs.processes.membership import (
    LEFT_AFTER_NS,
    MOST_WARNINGS,
    RECORDER,
    VEHICLE,
    Fingerprint,
    Membership,
    RecorderWatch,
    checked_run_name,
)
from tests.made.scenarios.messages import at
from tests.made.scenarios.recorded_drives import as_plane_csv
from tests.made.scenarios.recorded_drives import drive as recorded_drive
from transport.bus.bus import BusError, MemoryBus, MemoryNetwork
from vehicles.schedule import SECOND

Sleep = Callable[[float], object]


def scenario(*overrides: str, name: str = "lane_change", seed: int | None = None) -> Scenario:
    return load_scenario(name, overrides, seed)


def without_sessions(text: str) -> str:
    return re.sub(r" \(session [0-9a-f]+\)", "", text)


class Network:
    """Processes of one run over memory."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.buses: dict[str, MemoryBus] = {}

    def join(
        self, role: str, name: str, what: Scenario, sleep: Sleep = lambda _: None
    ) -> Membership:
        bus = MemoryBus(self.network)
        member = Membership(bus, "mine", role, name, Fingerprint.of(what))
        try:
            member.join(sleep=sleep)
        except BusError:
            bus.close()
            raise
        self.buses[name] = bus
        return member


def test_members_of_one_run_see_one_another() -> None:
    here = Network()
    first = here.join(VEHICLE, "v1", scenario())
    assert not first.recorder_is_present
    recorder = here.join(RECORDER, "recorder", scenario())
    here.join(VEHICLE, "v2", scenario())
    assert first.recorder_is_present
    assert recorder.vehicles == {"v1", "v2"}
    here.buses["v2"].close()
    assert recorder.vehicles == {"v1"}


@pytest.mark.parametrize(
    ("role", "name", "line"),
    [
        (
            RECORDER,
            "recorder",
            "run mine: there is a recorder already; give another --run",
        ),
        (VEHICLE, "v1", "run mine: there is a vehicle v1 already; give another --run"),
    ],
)
def test_a_second_of_one_name_is_refused_and_the_first_stays(
    role: str, name: str, line: str
) -> None:
    here = Network()
    here.join(VEHICLE, "v1", scenario())
    recorder = here.join(RECORDER, "recorder", scenario())
    with pytest.raises(BusError) as refused:
        here.join(role, name, scenario())
    assert without_sessions(str(refused.value)) == line
    assert recorder.vehicles == {"v1"}
    assert here.network.alive == {
        member for member in here.network.alive if member.session in {"0", "1"}
    }


@pytest.mark.parametrize(
    ("other", "what"),
    [
        (scenario(seed=7), "the recorder has seed 1, here it is 7"),
        (
            scenario(name="highway"),
            "the recorder has scenario lane_change, here it is highway",
        ),
        (
            scenario("convoy.gap_m=4"),
            "the recorder has another content of scenario lane_change (file or --set)",
        ),
    ],
    ids=["seed", "scenario", "override"],
)
def test_a_vehicle_of_something_else_is_refused_with_what_differs(
    other: Scenario, what: str
) -> None:
    here = Network()
    here.join(VEHICLE, "v1", scenario())
    here.join(RECORDER, "recorder", scenario())
    with pytest.raises(BusError) as refused:
        here.join(VEHICLE, "v2", other)
    assert without_sessions(str(refused.value)) == f"run mine: {what}"


def other_program(monkeypatch: pytest.MonkeyPatch, **parts: str) -> None:
    """Let processes that join from now on be of a program that differs in `parts`."""
    stamp = replace(current_stamp(), **parts)
    monkeypatch.setattr("scenarios.runs.processes.membership.current_stamp", lambda: stamp)


def test_a_vehicle_with_another_recorded_drive_is_refused(tmp_path: Path) -> None:
    here, drive = Network(), tmp_path / "drive.csv"
    what = []
    for shift_m in (0.0, 0.5):
        points = [(t, e, n + shift_m * (t > 1.0), v) for t, e, n, v in recorded_drive()]
        drive.write_bytes(as_plane_csv(points))
        what.append(load_scenario(str(drive)))
    here.join(RECORDER, "recorder", what[0])
    with pytest.raises(BusError, match="another content of scenario drive"):
        here.join(VEHICLE, "v2", what[1])


def test_a_vehicle_waiting_for_its_recorder_is_named_by_an_unequal_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    here = Network()
    own = asdict(current_stamp())
    waiting = here.join(VEHICLE, "v2", scenario())
    other_program(monkeypatch, sources="0" * 12)
    recorder = here.join(RECORDER, "recorder", scenario())
    why = f"runs other sources: {own['sources']}, here 000000000000"
    assert recorder.excluded() == {"v2": why}
    assert [*map(without_sessions, recorder.new_warnings())] == [f"v2 {why}; it does not take part"]
    assert recorder.new_warnings() == []
    assert without_sessions(waiting.refusal()).startswith(
        "the recorder runs other sources: 000000000000"
    )


@pytest.mark.parametrize("fingerprint", ["something", "~".join("abcdefgh")])
def test_a_stranger_s_token_stops_nobody(fingerprint: str) -> None:
    here = Network()
    MemoryBus(here.network).announce(VEHICLE, "v1", fingerprint)
    recorder = here.join(RECORDER, "recorder", scenario())
    here.join(VEHICLE, "v1", scenario())
    here.join(VEHICLE, "v2", scenario())
    assert recorder.vehicles == {"v1", "v2"}
    assert recorder.excluded() == {}
    (line,) = recorder.new_warnings()
    assert line.startswith("v1 (session 0) has ")


def test_of_two_that_join_at_the_same_instant_one_stays() -> None:
    here = Network()
    first, third = MemoryBus(here.network), MemoryBus(here.network)
    chunk = Fingerprint.of(scenario()).chunk
    second = Membership(third, "mine", VEHICLE, "v1", Fingerprint.of(scenario()))
    # Each passes its first check before the other announces itself.
    with pytest.raises(BusError, match="there is a vehicle v1 already"):
        second.join(sleep=lambda _: first.announce(VEHICLE, "v1", chunk))
    second = Membership(MemoryBus(here.network), "mine", VEHICLE, "v7", Fingerprint.of(scenario()))
    second.join(sleep=lambda _: None)
    first.announce(VEHICLE, "v7", chunk)  # a slow network delivers it after the join
    with pytest.raises(BusError, match="there is a vehicle v7 already"):
        second.check()
    first.close()
    third.close()
    first, third = MemoryBus(here.network), MemoryBus(here.network)
    stays = Membership(first, "mine", VEHICLE, "v1", Fingerprint.of(scenario()))
    stays.join(sleep=lambda _: third.announce(VEHICLE, "v1", chunk))


def test_a_recorder_has_left_when_it_was_there_and_is_gone_for_a_while() -> None:
    here = Network()
    vehicle = here.join(VEHICLE, "v1", scenario())
    watch = RecorderWatch(vehicle, here.buses["v1"])
    assert not watch.has_left(at(0.0))
    assert not watch.has_left(at(100.0))  # it has not come yet
    here.join(RECORDER, "recorder", scenario())
    assert not watch.has_left(at(101.0))
    here.buses["recorder"].close()
    assert not watch.has_left(at(102.0))
    assert not watch.has_left(at(102.0 + LEFT_AFTER_NS / SECOND))
    assert watch.has_left(at(102.1 + LEFT_AFTER_NS / SECOND))


@pytest.mark.parametrize("name", ["", "a/b", "a b", "@x", "*", "ä", "x" * 101, "a\n"])
def test_a_run_s_name_is_one_chunk_of_a_key(name: str) -> None:
    with pytest.raises(BusError, match="letters, digits, underscores and hyphens") as refused:
        checked_run_name(name)
    assert "\n" not in str(refused.value)
    assert checked_run_name("lane_change-2") == "lane_change-2"


@pytest.mark.parametrize(
    ("parts", "line"),
    [
        ({"convoy": "99.0"}, "the recorder has version {convoy}, here it is 99.0"),
        (
            {"sources": "0" * 12},
            "the recorder runs other sources: {sources}, here 000000000000",
        ),
    ],
    ids=["version", "sources"],
)
def test_a_vehicle_of_another_program_is_refused(
    parts: dict[str, str], line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = Network()
    recorder = here.join(RECORDER, "recorder", scenario())
    own = asdict(current_stamp())
    other_program(monkeypatch, **parts)
    with pytest.raises(BusError) as refused:
        here.join(VEHICLE, "v2", scenario())
    assert without_sessions(str(refused.value)) == f"run mine: {line.format(**own)}"
    assert recorder.vehicles == set()


def test_a_vehicle_with_another_controller_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    controller = tmp_path / "own_law.py"
    source = "from vehicles.driver.steering import Stanley\nclass Mine(Stanley):\n    sign = {}\n"
    what = []
    for sign in (1, -1):
        controller.write_text(source.format(sign))
        _module_digest.cache_clear()  # as in another process
        what.append(Fingerprint.of(scenario('control.controller="own_law.Mine"')))
    (here, there) = what
    assert "own_law:" in here.difference(there.chunk)
    assert replace(there, plug_ins=here.plug_ins) == here


def test_strangers_cannot_fill_the_log_with_warnings() -> None:
    here = Network()
    recorder = here.join(RECORDER, "recorder", scenario())
    for number in range(3 * MOST_WARNINGS):
        MemoryBus(here.network).announce(VEHICLE, f"x{number}", "something")
    assert len(recorder.new_warnings()) == MOST_WARNINGS
    assert recorder.new_warnings() == []


def test_a_stranger_s_vehicle_counts_for_nothing() -> None:
    here = Network()
    recorder = here.join(RECORDER, "recorder", scenario())
    MemoryBus(here.network).announce(VEHICLE, "v3", Fingerprint.of(scenario(seed=9)).chunk)
    assert recorder.vehicles == set()


def test_other_versions_of_python_and_numpy_are_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    here = Network()
    recorder = here.join(RECORDER, "recorder", scenario())
    other_program(monkeypatch, numpy="1.0", python="3.99")
    vehicle = here.join(VEHICLE, "v2", scenario())
    assert recorder.vehicles == {"v2"}
    assert vehicle.recorder_is_present
    (line,) = recorder.new_warnings()
    assert line.startswith("v2 (session 1) runs ")
    assert "3.99" in line
    assert "1.0" in line
