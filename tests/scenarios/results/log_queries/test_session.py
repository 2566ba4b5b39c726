"""The scenario that a log comes to: what it was, with what was done by hand, to the nanosecond."""

import json
from collections.abc import Sequence
from pathlib import Path

from scenarios.definition.scenario import load_scenario, scenario_from_text
from scenarios.runs.replayed import session_of
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport.logs import put
from transport.log.reader import LogReader
from transport.log.writer import LogWriter
from vehicles.messages import Change, LinkVerdict, RunStart
from vehicles.schedule import nanoseconds

START = 1_790_000_000_123_456_789
SCENARIO = """
extends = "lane_change"
name = "session"
duration_s = 4.0
[[change]]
kind = "link"
at_s = 0.5
sender = "v2"
receiver = "v3"
loss_ratio = 0.25
"""


def changed(by: str, seq: int, after: int, *, by_hand: bool = True, **entry: object) -> Change:
    """A change that a vehicle made `after` (ns) the start."""
    at_s = after / 1e9
    table = json.dumps({**entry, "at_s": at_s})
    return Change(
        vehicle=by, seq=seq, effective_at_ns=START + after, kind=str(entry["kind"]),
        by_hand=by_hand, table=table,
    )  # fmt: skip


def log_of(path: Path, changes: Sequence[Change]) -> Path:
    """A log of a run in which that was done."""
    with LogWriter(path, library="test") as log:
        text = scenario_from_text(SCENARIO).text
        log.attach("scenario.toml", "application/toml", text.encode())
        put(log, START, RunStart(vehicle="run", seq=0, start_at_ns=START, run_id="x"))
        for change in changes:
            put(log, change.effective_at_ns, change)
    return path


def entries(log: Path) -> list[dict[str, object]]:
    return [
        one.model_dump(exclude_unset=True, exclude_none=True)
        for one in session_of(log).tables.change
    ]


def test_one_change_of_several_receivers_stays_one_change(tmp_path: Path) -> None:
    after = 1_234_567_891
    log = log_of(
        tmp_path / "a.mcap",
        [
            changed("v3", 0, 500_000_000, by_hand=False, kind="link", sender="v2", receiver="v3",
                    loss_ratio=0.25),
            *(changed(name, 0, after, kind="cut", for_s=0.5) for name in ("v4", "v1", "v2")),
            changed("v3", 1, after, kind="cut", for_s=0.5),
        ],
    )  # fmt: skip
    found = entries(log)
    assert found == [
        {"kind": "link", "at_s": 0.5, "sender": "v2", "receiver": "v3", "loss_ratio": 0.25},
        {"kind": "cut", "at_s": 1.234567891, "for_s": 0.5},
    ]
    assert nanoseconds(float(str(found[1]["at_s"]))) == after


def test_receivers_that_made_it_at_other_instants_or_not_at_all_stay_apart(tmp_path: Path) -> None:
    log = log_of(
        tmp_path / "a.mcap",
        [
            changed("v3", 0, 1_020_000_000, kind="cut", sender="predecessor"),
            changed("v2", 0, 1_000_000_000, kind="cut", sender="predecessor"),
            changed("v4", 0, 1_000_000_000, kind="cut", sender="predecessor"),
        ],
    )
    rest = entries(log)[1:]
    assert [(one["at_s"], one["sender"], one["receiver"]) for one in rest] == [
        (1.0, "predecessor", "v2"),
        (1.0, "predecessor", "v4"),
        (1.02, "predecessor", "v3"),
    ]


def test_the_session_of_a_session_is_itself_and_drives_alike(tmp_path: Path) -> None:
    """What was by hand is scheduled then: nothing is to be added, and the links decide the same."""
    log = log_of(
        tmp_path / "a.mcap",
        [changed(name, 0, 1_000_000_000, kind="cut", for_s=1.0) for name in ("v2", "v3", "v4")],
    )
    once = session_of(log)
    run_virtual(once, tmp_path / "run", Stop())
    driven = tmp_path / "run" / "run.mcap"
    assert session_of(driven).text == once.text
    start_at = once.start_at_ns
    cut = {
        m.sent_at_ns - start_at
        for _, _, m in LogReader(driven).messages(("verdict",))
        if isinstance(m, LinkVerdict) and m.reason == "cut"
    }
    assert cut == {k * 50_000_000 for k in range(20, 40)}
    plain = load_scenario("lane_change", ["duration_s=4"])
    run_virtual(plain, tmp_path / "plain", Stop())
    assert not any(
        isinstance(m, LinkVerdict) and m.reason == "cut"
        for _, _, m in LogReader(tmp_path / "plain" / "run.mcap").messages(("verdict",))
    )
