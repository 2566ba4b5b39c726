"""A convoy of real processes under live changes, and the repetition of the session."""

from pathlib import Path
from time import monotonic, sleep

import pytest

from scenarios.cli.change_requests import joined, request_change
from scenarios.runs.open_runs import open_runs
from tests.system.logs import Run, assert_equal_while_nothing_was_late
from tests.system.processes import Process, invoke, start
from transport.bus.bus import BusError
from vehicles.messages import Change, LinkVerdict
from vehicles.schedule import SECOND

NO_FLAGS = {"connect": (), "listen": (), "config": None, "cfg": (), "mode": None}
CONFIRMED_MS = 300.0
"""Upper bound of the median response time, also on a busy machine."""
DURATION_S, BETWEEN_S = 13.0, 0.6
SESSION = (
    {"kind": "link", "sender": "v1", "receiver": "v3", "loss_ratio": 0.3, "latency_ms": 200.0},
    {"kind": "cut", "for_s": 0.5},
    {"kind": "gnss", "vehicle": "v2", "fix": "float", "for_s": 1.0},
    {"kind": "link", "sender": "predecessor", "receiver": "*", "loss_ratio": 0.5, "for_s": 2.0},
    {"kind": "stall", "vehicle": "v3", "for_s": 0.4},
    {"kind": "link", "sender": "*", "receiver": "follower", "jitter_ms": 60.0},
    {"kind": "cut", "sender": "lead", "receiver": "v4"},
    {"kind": "speed", "speed_mps": 25.0},
    {"kind": "heal"},
    {"kind": "crash", "vehicle": "v4", "for_s": 3.0},
)
Verdicts = dict[tuple[str, str, int], tuple[str, str, int]]


def verdicts(run: Run) -> Verdicts:
    """Outcome, reason and visible instant (ns after the start) of each message."""
    return {
        (m.sender, m.vehicle, m.pose_seq): (m.outcome, m.reason, m.visible_at_ns - run.start_at)
        for m in run.messages
        if isinstance(m, LinkVerdict)
    }


def await_live_control(convoy: Process, run_name: str) -> None:
    """Wait until a run accepts changes."""
    convoy.drive(0.5)
    assert run_name in {entry.run for entry in open_runs()}


def test_a_session_is_confirmed_logged_and_repeated(tmp_path: Path) -> None:
    took_ms, effects = [], []
    arguments = ("run", "lane_change", f"--set=duration_s={DURATION_S}", "--run=live_session")
    with start(*arguments, "--out=live", folder=tmp_path) as convoy:
        await_live_control(convoy, "live_session")
        with joined("live_session", NO_FLAGS) as (bus, run):
            for entry in SESSION:
                answers = request_change(bus, run, entry)
                assert not any(a.answer is None or a.answer.refused for a in answers)
                took_ms += [a.took_ms for a in answers]
                effects += [
                    (a.vehicle, a.answer.from_s) for a in answers if a.answer and a.answer.does
                ]
                sleep(BETWEEN_S)
        assert convoy.wait() == 0
    assert sorted(took_ms)[len(took_ms) // 2] < CONFIRMED_MS
    assert max(took_ms) < 10 * CONFIRMED_MS
    live = Run(tmp_path / "live")
    changes = [m for m in live.messages if isinstance(m, Change)]
    logged = [(m.vehicle, (m.effective_at_ns - live.start_at) / SECOND) for m in changes]
    assert sorted(logged) == sorted(effects)
    assert all(m.by_hand for m in changes)
    done = invoke("scenario-from", "live", "-o", "session.toml", folder=tmp_path)
    assert (done.exit_code, done.stderr) == (0, "")
    assert (tmp_path / "session.toml").read_text().count("[[change]]") >= len(SESSION)
    again = invoke(
        "run", "session.toml", "--clock=virtual", "--quiet", "--out=again", folder=tmp_path
    )
    assert again.exit_code == 0, again.output
    live_verdicts, repeated = verdicts(live), verdicts(Run(tmp_path / "again"))
    assert {reason for _, reason, _ in live_verdicts.values()} == {"", "cut", "loss"}
    both = live_verdicts.keys() & repeated.keys()
    for_v4 = {key for key in repeated if key[1] == "v4"}  # whose process restarts
    assert len(both - for_v4) >= 0.99 * len(repeated.keys() - for_v4)
    assert len(both & for_v4) >= 0.5 * len(for_v4)
    assert {key: live_verdicts[key] for key in both} == {key: repeated[key] for key in both}
    # Messages in flight at the end may differ, and those missed by a process that restarts late.
    last_at = (DURATION_S - 0.5) * SECOND
    differing = {
        **{k: live_verdicts[k] for k in live_verdicts.keys() - both},
        **{k: repeated[k] for k in repeated.keys() - both},
    }
    assert all(at >= last_at or to == "v4" for (_, to, _), (_, _, at) in differing.items())


SCHEDULED = """
extends = "lane_change"
name = "scheduled"
duration_s = 5.0
[[change]]
kind = "cut"
at_s = 1.0
for_s = 0.4
[[change]]
kind = "link"
at_s = 2.0
sender = "lead"
receiver = "follower"
loss_ratio = 0.4
latency_ms = 60.0
for_s = 1.5
[[change]]
kind = "cut"
at_s = 3.0
sender = "predecessor"
[[change]]
kind = "heal"
at_s = 4.0
"""


def test_scheduled_changes_act_alike_on_both_clocks(tmp_path: Path) -> None:
    (tmp_path / "scheduled.toml").write_text(SCHEDULED)
    arguments = ("run", "scheduled.toml", "--quiet")
    with start(*arguments, "--out=wall", folder=tmp_path) as process:
        done = invoke(*arguments, "--clock=virtual", "--out=virtual", folder=tmp_path)
        assert done.exit_code == 0, done.output
        assert process.wait() == 0, process.err
    wall, virtual = Run(tmp_path / "wall"), Run(tmp_path / "virtual")
    by_wall, by_virtual = verdicts(wall), verdicts(virtual)
    both = by_wall.keys() & by_virtual.keys()
    assert len(both) >= 0.99 * len(by_virtual)
    assert {key: by_wall[key] for key in both} == {key: by_virtual[key] for key in both}
    assert_equal_while_nothing_was_late(wall, virtual, within_m=0.05)
    for run in (wall, virtual):
        # The lead has links for all receivers, not for those of its own messages.
        assert sum(isinstance(m, Change) for m in run.messages) == 4 + 3 + 3 + 4
        (warning,) = [line for line in run.summary["warnings"] if "changed during" in line]
        assert warning.endswith(": all")


def test_commands_find_the_only_run_on_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a run, or with several, the command fails with one line that names --run."""
    (tmp_path / "runtime").mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    arguments = ("run", "lane_change", "--set=convoy.vehicles=2")
    none = invoke("cut", folder=tmp_path)
    assert none.exit_code == 2
    assert none.stderr.count("\n") == 1
    assert "--run" in none.stderr
    with start(*arguments, "--set=duration_s=25", "--out=one", folder=tmp_path) as convoy:
        convoy.drive(0.5)
        cut = invoke("cut", "--for", "200ms", folder=tmp_path)
        assert (cut.exit_code, cut.stderr) == (0, "")
        run_line, change_line = cut.stdout.splitlines()
        assert open_runs()[0].run in run_line
        assert str(tmp_path / "one") in run_line
        assert change_line.startswith("v2: cut for 0.2 s, ")
        refused = invoke("link", "v1", "v2", "--loss", "2", folder=tmp_path)
        assert (refused.exit_code, refused.stdout) == (2, "")
        assert refused.stderr.startswith("error: --loss: given 2, allowed 0 to 1")
        status = invoke("status", "--once", folder=tmp_path)
        assert status.exit_code == 0, status.output
        assert "v1 → v2" in status.stdout
        with start(*arguments, "--set=duration_s=4", "--out=two", folder=tmp_path) as other:
            other.await_start()
            ambiguous = invoke("cut", folder=tmp_path)
            assert ambiguous.exit_code == 2
            names = ", ".join(entry.run for entry in open_runs())
            assert "--run" in ambiguous.stderr
            assert names in ambiguous.stderr
    assert open_runs() == []


def test_an_unreachable_run_is_reported_within_seconds() -> None:
    started_at = monotonic()
    with (
        pytest.raises(BusError) as refused,
        joined("nobody", {**NO_FLAGS, "connect": ("tcp/127.0.0.1:1",)}),
    ):
        pass
    assert "cannot join through tcp/127.0.0.1:1" in str(refused.value)
    assert monotonic() - started_at < 10.0
