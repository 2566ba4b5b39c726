"""A launch as a history: which process ended when and how, and what became of the run."""

import signal
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.live import LiveRun
from scenarios.runs.processes.supervisor import (
    NOTICED_S,
    RECORDER_FAILED,
    WATCH_PERIOD_S,
    LaunchPlan,
    RunOutcome,
    Supervisor,
    launch,
)
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import Stop
from tests.made.scenarios.messages import START
from transport.bus.bus import BusError
from transport.clock import SystemTime
from transport.log.mcap_file import repair_if_truncated
from transport.log.reader import LogReader

ENDPOINT = "tcp/127.0.0.1:4711"
SEGMENTATION_FAULT = -signal.SIGSEGV
Event = tuple[float, str, int]
"""Time (s), process, exit code. `SIGINT` stops the launcher, with the given exit code."""


@dataclass(eq=False)
class FakeChild:
    """A process that ends at the instant in its history."""

    name: str
    arguments: Sequence[str]
    exit_code: int | None = None


@dataclass
class FakeSupervisor:
    """Starts nothing: children end by their history, and all calls are kept."""

    router_starts: bool = True
    recorder_ends_with: int = 1
    children: list[FakeChild] = field(default_factory=list)
    started: list[FakeChild] = field(default_factory=list)
    calls: list[tuple[str, ...]] = field(default_factory=list)

    def start_router(self) -> str:
        if not self.router_starts:
            raise BusError("the router did not start")
        self.start("router", ())
        return ENDPOINT

    def start(self, name: str, arguments: Sequence[str]) -> FakeChild:
        child = FakeChild(name, arguments)
        self.children.append(child)
        self.started.append(child)
        return child

    def send_reason(self, name: str, reason: str) -> None:
        self.calls.append(("send reason", name, reason))

    def ended(self) -> list[FakeChild]:
        ended = [child for child in self.children if child.exit_code is not None]
        self.children = [child for child in self.children if child.exit_code is None]
        return ended

    def stop(self, names: Sequence[str] | None = None, grace_s: float = 3.0) -> None:
        assert 0.0 < grace_s <= 3.0
        chosen = [child.name for child in self.children if names is None or child.name in names]
        self.calls.append(("stop", *chosen))
        for child in self.children:
            if child.name == "recorder" and child.name in chosen:
                child.exit_code = self.recorder_ends_with
        self.children = [child for child in self.children if child.name not in chosen]


@dataclass
class Launched:
    """What became of a launch."""

    outcome: RunOutcome
    supervisor: FakeSupervisor
    over: float

    @property
    def ending(self) -> tuple[int, str]:
        return self.outcome.exit_code, self.outcome.reason


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "run"


def scenario(*, goes_on: bool = False) -> Scenario:
    policy = "continue" if goes_on else "end"
    return load_scenario(
        "lane_change", ["convoy.vehicles=3", f'convoy.on_vehicle_failure="{policy}"']
    )


def play(
    folder: Path, *history: Event, goes_on: bool = False, recorder_ends_with: int = 1
) -> Launched:
    """Launch a convoy whose processes live through `history`, in no time.

    A recorder that is stopped ends with the given exit code.
    """
    supervisor, stop = FakeSupervisor(recorder_ends_with=recorder_ends_with), Stop()
    waiting, now = sorted(history), 0.0

    def sleep(seconds: float) -> None:
        nonlocal now
        now += seconds
        assert now < 60.0, "the run does not end"
        while waiting and waiting[0][0] <= now:
            _, name, code = waiting.pop(0)
            if name == "SIGINT":
                stop.request("stopped by SIGINT", code)
            for child in supervisor.children:
                if child.name == name:
                    child.exit_code = code

    plan = LaunchPlan(
        scenario(goes_on=goes_on), ["my.toml", "--seed=3"], folder, ["--quiet"], "mine"
    )
    system = SystemTime(sleep=sleep)
    outcome = launch(plan, stop, cast("Supervisor", supervisor), repair_if_truncated, system=system)
    assert supervisor.children == []  # whatever happened, no process is left behind
    return Launched(outcome, supervisor, now)


# ---- Starting


def test_every_process_gets_the_scenario_and_the_router_endpoint(folder: Path) -> None:
    started = play(folder, (1.0, "recorder", 0)).supervisor.started
    assert [child.name for child in started] == ["router", "recorder", "v1", "v2", "v3"]
    common = ["my.toml", "--seed=3", "--parent-watch", "--run", "mine", "-e", ENDPOINT]
    assert started[1].arguments == ["record", *common, "--out", str(folder), "--quiet"]
    for child in started[2:]:
        assert child.arguments == ["vehicle", *common, "--name", child.name]


def test_without_its_router_a_run_fails_and_nothing_else_is_started(folder: Path) -> None:
    supervisor = FakeSupervisor(router_starts=False)
    plan = LaunchPlan(scenario(), ["lane_change"], folder, [], "mine")
    outcome = launch(plan, Stop(), cast("Supervisor", supervisor), repair_if_truncated)
    assert (outcome.exit_code, outcome.reason) == (1, "the router did not start")
    assert supervisor.started == []


# ---- Ending

RECORDED = (20.0, "recorder", 0)
COMPLETED = 0, ""
SIGINT = 130, "stopped by SIGINT"
ENDS: dict[str, tuple[list[Event], tuple[int, str], float]] = {
    # history, exit code and reason, and when the run is over (s)
    "completed": ([(19.5, "v1", 0), (19.5, "v2", 0), RECORDED], COMPLETED, 20.0),
    "a vehicle killed": (
        [(7.0, "v2", SEGMENTATION_FAULT), RECORDED],
        (1, "v2 was killed by signal 11"),
        7.0,
    ),
    "a vehicle failed": ([(1.0, "v3", 2), RECORDED], (1, "v3 ended with exit code 2"), 1.0),
    "router killed": ([(5.0, "router", -9)], (1, "router was killed by signal 9"), 5.0 + NOTICED_S),
    "router killed after all": ([(20.0, "router", -9), RECORDED], COMPLETED, 20.0),
    "recorder failed": ([(5.0, "recorder", 1)], (1, RECORDER_FAILED), 5.0),
    "recorder killed": ([(5.0, "recorder", -9)], (1, "recorder was killed by signal 9"), 5.0),
    "router fails with all": (
        [(5.0, "v1", -9), (5.0, "v2", -15), (5.0, "router", 1)],
        (1, "router ended with exit code 1"),
        5.0,
    ),
    "the first failure decides": (
        [(5.0, "v2", -15), (5.5, "v1", -9)],
        (1, "v2 was killed by signal 15"),
        5.0,
    ),
    "stopped": ([(4.0, "SIGINT", 130), RECORDED], SIGINT, 4.0),
    "a stop and the deaths that it brings": (
        [(4.0, "SIGINT", 130), (4.0, "v1", -2), (4.0, "recorder", 1)],
        SIGINT,
        4.0,
    ),
    "stopped after all": ([RECORDED, (20.1, "SIGINT", 130)], COMPLETED, 20.0),
}


@pytest.mark.parametrize("name", ENDS)
def test_the_first_reason_decides_how_a_run_ends(folder: Path, name: str) -> None:
    history, ending, over = ENDS[name]
    launched = play(folder, *history)
    assert launched.ending == ending
    assert launched.over == pytest.approx(over, abs=2 * WATCH_PERIOD_S + NOTICED_S)
    assert not launched.outcome.repaired
    (told,) = [call for call in launched.supervisor.calls if call[0] == "send reason"]
    assert told[1] == "recorder"


def test_vehicles_are_stopped_before_the_recorder_which_gets_their_last_messages(
    folder: Path,
) -> None:
    launched = play(folder, (7.0, "v2", SEGMENTATION_FAULT), RECORDED)
    assert launched.supervisor.calls == [
        ("send reason", "recorder", "v2 was killed by signal 11"),
        ("stop", "v1", "v3"),
        ("stop", "recorder"),
        ("stop", "router"),
    ]


@pytest.mark.parametrize(
    ("event", "ending"),
    [
        ((7.0, "v2", SEGMENTATION_FAULT), COMPLETED),
        ((7.0, "v3", 1), COMPLETED),
        ((5.0, "router", -9), (1, "router was killed by signal 9")),
        ((5.0, "recorder", -9), (1, "recorder was killed by signal 9")),
    ],
)
def test_the_convoy_continues_without_failed_vehicles_if_requested(
    folder: Path, event: Event, ending: tuple[int, str]
) -> None:
    assert play(folder, event, RECORDED, goes_on=True).ending == ending


@pytest.mark.parametrize("source", ["v2", "SIGINT", "router"])
def test_the_outcome_is_that_of_the_recorder_that_completed_its_run(
    folder: Path, source: str
) -> None:
    launched = play(folder, (19.5, source, -9), recorder_ends_with=0)
    assert launched.ending == COMPLETED


# ---- The log


def broken_off(folder: Path) -> None:
    """Leave the log of a recorder that was killed."""
    run = RunLog(scenario(), folder, clock="wall", run_id="run", live=LiveRun(scenario()))
    run.start(START, START)
    run.flush()
    content = (folder / LOG_NAME).read_bytes()
    run.end(START, "")
    run.close(START)
    (folder / LOG_NAME).write_bytes(content)


def test_a_log_that_another_process_writes_is_left_alone(folder: Path) -> None:
    run = RunLog(scenario(), folder, clock="wall", run_id="other", live=LiveRun(scenario()))
    run.start(START, START)
    run.flush()
    before = (folder / LOG_NAME).read_bytes()
    assert not play(folder, (5.0, "recorder", 2)).outcome.repaired
    assert (folder / LOG_NAME).read_bytes() == before
    run.end(START, "")
    run.close(START)
    assert not LogReader(folder / LOG_NAME).truncated


def test_a_log_that_its_recorder_could_not_complete_is_repaired(folder: Path) -> None:
    broken_off(folder)
    assert LogReader(folder / LOG_NAME).truncated
    launched = play(folder, (5.0, "recorder", -9))
    assert launched.outcome.repaired
    assert launched.ending == (1, "recorder was killed by signal 9")
    assert not LogReader(folder / LOG_NAME).truncated
