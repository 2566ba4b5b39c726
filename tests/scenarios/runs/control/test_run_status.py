"""The recorder's answer to how a run goes: fresh while somebody asks, and made seldom otherwise."""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.metrics import Metrics
from scenarios.runs.control import run_status
from scenarios.runs.control.run_status import OFTEN_NS, RunStatus, StatusBoard
from tests.made.scenarios.messages import START, start, truth
from transport.bus.memory_bus import MemoryBus
from transport.topics import RUN_SENDER, control_key
from vehicles.schedule import SECOND

STEP_NS = SECOND // 5


class Asked:
    """A board that is drawn five times a second, and that somebody may ask."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        scenario = load_scenario("lane_change")
        self.board = StatusBoard(scenario, "mine", Metrics.of(scenario))
        self.bus = MemoryBus()
        self.board.serve(self.bus)
        self.drawn = 0
        self.now = START
        one = self.board.status(START)

        def count(_board: StatusBoard, _start_at: int) -> RunStatus:
            self.drawn += 1
            return one

        monkeypatch.setattr(run_status.StatusBoard, "status", count)

    def go(self, seconds: float) -> None:
        for _ in range(round(seconds * SECOND / STEP_NS)):
            self.now += STEP_NS
            self.board.update(self.now)

    def ask(self) -> bytes | None:
        return self.bus.query(control_key(RUN_SENDER), 1.0)


def test_it_is_drawn_once_a_second_and_often_while_somebody_asks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = Asked(monkeypatch)
    asked.go(2.0)
    assert asked.ask() == b""  # not started
    assert asked.drawn == 0
    asked.board.listen(START, start())
    asked.go(2.0 * OFTEN_NS / SECOND)  # the question before the start counts, too
    asked.drawn = 0
    asked.go(4.0)
    assert asked.drawn == 4
    assert RunStatus.of(asked.ask() or b"").run == "mine"
    asked.drawn = 0
    asked.go(4.0)
    assert asked.drawn == 20
    asked.go(4.0)
    asked.drawn = 0
    asked.go(4.0)
    assert asked.drawn == 4


def test_what_is_answered_is_of_the_last_drawing() -> None:
    scenario = load_scenario("lane_change", ["convoy.vehicles=2"])
    metrics = Metrics.of(scenario)
    board, bus = StatusBoard(scenario, "mine", metrics), MemoryBus()
    board.serve(bus)
    for message in (start(), truth("v1", 50, 30.0, 0.0)):
        metrics.listen(0, message)
        board.listen(START, message)
    board.update(START + SECOND)
    found = RunStatus.of(bus.query(control_key(RUN_SENDER), 1.0) or b"")
    assert (found.at_s, found.vehicles[0].speed_mps) == (1.0, 20.0)
