"""The recorder's status: empty before the start, then that of the last evaluation."""

from scenarios.runs.live import LiveRun
from scenarios.runs.run_status import RECENT_NS, LinkStatus, RunStatus, StatusBoard
from tests.made.scenarios.messages import at, start, truth, verdict
from tests.made.scenarios.tables import straight_scenario
from transport.bus.bus import MemoryBus
from transport.topics import RUN_SENDER, control_key
from vehicles.schedule import SECOND

LOST_S = 4.0
"""From here on the link loses all poses."""
END_S = LOST_S + RECENT_NS / SECOND - 1.0


def test_the_status_is_that_of_the_last_evaluation_with_the_recent_loss() -> None:
    live, bus = LiveRun(straight_scenario(2)), MemoryBus()
    board = StatusBoard(live.scenario, "mine")
    board.serve(bus)
    assert bus.query(control_key(RUN_SENDER), 1.0) == b""
    live.listen(at(0.0), start())
    for seq in range(round(END_S * 20) + 1):
        dropped = "loss" if seq >= 20 * LOST_S else ""
        live.listen(at(seq / 20), verdict("v1", "v2", seq, latency_ms=0.0, dropped=dropped))
    for name, east in (("v1", 0.0), ("v2", -15.0)):
        live.listen(at(END_S), truth(name, round(END_S * 50), east, 0.0))
    assert live.update()
    board.update(live)
    status = RunStatus.of(bus.query(control_key(RUN_SENDER), 1.0) or b"")
    assert (status.run, status.at_s) == ("mine", END_S)
    assert [row.true_gap_m for row in status.vehicles] == [None, 10.0]
    link = next(row for row in status.links if row.receiver == "v2")
    judged = 20 * RECENT_NS // SECOND + 1
    lost = round((END_S - LOST_S) * 20) + 1
    assert link == LinkStatus(
        sender="v1", receiver="v2", judged=judged, loss_ratio=lost / judged, changed=False
    )
