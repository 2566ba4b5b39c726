"""The recorder's status: updated often while requests come, rarely otherwise."""

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.metrics import Metrics
from scenarios.runs import run_status
from scenarios.runs.run_status import OFTEN_NS, RunStatus, StatusBoard
from tests.made.scenarios.messages import START, start
from transport.bus.bus import MemoryBus
from transport.topics import RUN_SENDER, control_key
from vehicles.schedule import SECOND

STEP_NS = SECOND // 5


class Asked:
    """A board that is updated five times a second and answers requests."""

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


def test_the_status_is_updated_once_a_second_and_often_on_request(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    requested = Asked(monkeypatch)
    requested.go(2.0)
    assert requested.ask() == b""  # not started
    assert requested.drawn == 0
    requested.board.listen(START, start())
    requested.go(2.0 * OFTEN_NS / SECOND)  # the question before the start counts, too
    requested.drawn = 0
    requested.go(4.0)
    assert requested.drawn == 4
    assert RunStatus.of(requested.ask() or b"").run == "mine"
    requested.drawn = 0
    requested.go(4.0)
    assert requested.drawn == 20
    requested.go(4.0)
    requested.drawn = 0
    requested.go(4.0)
    assert requested.drawn == 4
