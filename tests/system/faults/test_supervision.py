"""Ends of a run: no process remains, the log is readable, and the reason is recorded."""

import signal
import time
from collections.abc import Sequence
from contextlib import ExitStack
from itertools import pairwise
from math import hypot
from pathlib import Path

import psutil
import pytest

from scenarios.runs.processes.supervisor import LISTENING
from tests.system.logs import (
    Run,
    agreement,
    assert_nothing_missing,
    assert_sound,
    assert_summary_is_in_the_log,
)
from tests.system.processes import Process, invoke, start, until

LONG_S = 35.0
"""Longer than any of these tests."""
LOST_S = 0.5
"""Longest part of a run that may be missing in its log; see `assert_log_reaches`."""
BUSY_S = 0.75
"""Allowance for a busy machine."""
CONVOY = ("v1", "v2", "v3")


def three(folder: Path, *settings: str, duration_s: float = LONG_S) -> Sequence[object]:
    """Arguments of a run of three vehicles."""
    return (
        *("run", "lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}"),
        *(f"--set={setting}" for setting in settings),
        *("--out", folder / "run"),
    )


def assert_log_reaches(run: Run, instant: int) -> None:
    """Check that the log is valid and reaches `LOST_S` before `instant` (ns)."""
    assert_sound(run.log)
    lost_s = (instant - run.last_truth_at) * 1e-9
    assert lost_s < LOST_S + BUSY_S
    for name, poses in run.truths.items():
        assert [pose.seq for pose in poses.values()] == list(range(len(poses))), name


def only_error_line(convoy: Process) -> str:
    """The only line of a run after that of its start."""
    (_, line) = convoy.lines()
    return line


def assert_reason_printed(convoy: Process, run: Run) -> None:
    assert run.summary["reason"]
    assert run.summary["reason"] in convoy.out


def kill(process: psutil.Process) -> int:
    """Kill a process; return the instant (ns)."""
    process.send_signal(signal.SIGKILL)
    return time.time_ns()


@pytest.mark.parametrize("victim", ["v2", "recorder", "router"])
def test_a_killed_process_ends_the_run(victim: str, tmp_path: Path) -> None:
    with start(*three(tmp_path), folder=tmp_path) as convoy:
        convoy.drive(0.6)
        killed_at = kill(convoy.part(victim))
        assert convoy.ends_in_time()
        assert convoy.wait() == 1
        line = only_error_line(convoy)
    assert victim in line
    assert str(signal.SIGKILL.value) in line
    run = Run(tmp_path / "run")
    assert_log_reaches(run, killed_at)
    assert run.summary["outcome"] == "failed"
    assert_reason_printed(convoy, run)


def test_all_processes_end_if_the_launcher_is_killed(tmp_path: Path) -> None:
    with start(*three(tmp_path), folder=tmp_path) as convoy:
        convoy.drive(1.6)  # longer than what may be missing
        parts = len(CONVOY) + 5  # launcher, router, recorder, fork server and its resource tracker
        assert until(lambda: len(convoy.remaining()) == parts)
        killed_at = kill(convoy.part("launcher"))
        assert convoy.ends_in_time()
        assert "Traceback" not in convoy.err
    run = Run(tmp_path / "run")
    assert_log_reaches(run, killed_at)
    assert_summary_is_in_the_log(run)
    assert "launcher" in run.summary["reason"]
    assert_reason_printed(convoy, run)


def test_a_run_stops_on_a_signal(tmp_path: Path) -> None:
    with start(*three(tmp_path), folder=tmp_path) as convoy:
        convoy.drive(0.3)
        convoy.popen.send_signal(signal.SIGINT)
        sent_at = time.time_ns()
        assert convoy.ends_in_time()
        assert convoy.wait() == 130
        line = only_error_line(convoy)
    run = Run(tmp_path / "run")
    assert_log_reaches(run, sent_at)
    assert_summary_is_in_the_log(run)
    assert signal.SIGINT.name in line
    assert run.summary["reason"] == line
    assert_reason_printed(convoy, run)
    assert all(row["finished"] for row in run.summary["vehicles"])


def test_a_suspended_vehicle_catches_up_all_ticks(tmp_path: Path) -> None:
    duration_s, suspended_s = 2.5, 1.0
    arguments = three(tmp_path, duration_s=duration_s)
    virtual_arguments = (*arguments[:-1], "virtual", "--clock=virtual", "--quiet")
    with start(*arguments, folder=tmp_path) as convoy:
        vehicle = convoy.part("v2")  # now: a busy machine takes a second to find it
        convoy.drive(0.4)
        vehicle.suspend()
        time.sleep(suspended_s)
        vehicle.resume()
        assert convoy.wait() == 0, convoy.err
    assert invoke(*virtual_arguments, folder=tmp_path).exit_code == 0
    run = Run(tmp_path / "run")
    assert_nothing_missing(run, duration_s)
    assert run.vehicle("v2")["late_ticks"] >= 0.7 * suspended_s * 50
    assert run.vehicle("v2")["lateness_ms_max"] > 700 * suspended_s
    assert any("late ticks" in text for text in run.texts("v2"))
    (warning,) = [line for line in run.summary["warnings"] if "of the ticks began late" in line]
    assert warning.startswith(tuple("123456789"))
    assert "(v2)" in warning
    assert "--clock virtual" in warning
    assert warning in convoy.out
    steps = []
    for before, after in pairwise(run.truths["v2"].values()):
        assert after.true_at_ns - before.true_at_ns == 20_000_000
        steps.append(hypot(after.east_m - before.east_m, after.north_m - before.north_m))
    # 30 m/s for 20 ms, less where poses of the lead were late and v2 braked; no jumps.
    assert steps[0] == pytest.approx(0.6, rel=0.001)
    assert 0.25 < min(steps) <= max(steps) < 0.62
    assert all(abs(after - before) < 10.0 * 0.02**2 for before, after in pairwise(steps))
    # Messages of v2 from this time reach v3 late, and are counted.
    links = {(row["sender"], row["receiver"]): row for row in run.summary["links"]}
    assert links["v2", "v3"]["late"] >= 0.7 * suspended_s * 20
    found = agreement(run, Run(tmp_path / "virtual"))
    assert found.differ_at is None or found.differ_at > run.late_messages_at[0]


def test_a_vehicle_that_hangs_permanently_ends_the_run(tmp_path: Path) -> None:
    with start(*three(tmp_path), folder=tmp_path) as convoy:
        convoy.drive(0.3)
        convoy.part("v3").suspend()
        assert convoy.wait() == 1
        assert convoy.ends_in_time()
    run = Run(tmp_path / "run")
    assert "v3" in run.summary["reason"]
    assert_reason_printed(convoy, run)


def test_a_convoy_continues_without_failed_and_terminated_vehicles(tmp_path: Path) -> None:
    duration_s = 2.5
    settings = ("--set=convoy.vehicles=4", '--set=convoy.on_vehicle_failure="continue"')
    with start(*three(tmp_path, duration_s=duration_s), *settings, folder=tmp_path) as convoy:
        killed, terminated = convoy.part("v2"), convoy.part("v3")
        convoy.drive(0.4)
        killed.send_signal(signal.SIGKILL)
        terminated.send_signal(signal.SIGTERM)
        assert convoy.wait() == 0, convoy.err
        assert not convoy.remaining()
        lines = sorted(line for line in convoy.lines() if " after the start; " in line)
    assert len(lines) == 2
    for line, name, outcome in zip(lines, ("v2", "v3"), ("failed", "left"), strict=True):
        assert line.startswith(f"run: {name} {outcome} ")
        assert line.endswith("after the start; the convoy continues without it")
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert run.summary["outcome"] == "completed"
    finished = [row["finished"] for row in run.summary["vehicles"]]
    assert finished == [True, False, True, True]
    for name in ("v2", "v3"):
        assert run.vehicle(name)["poses"] < duration_s * 20 - 20
    for name in ("v1", "v4"):
        assert len(run.truths[name]) == duration_s * 50
        assert run.vehicle(name)["poses"] == duration_s * 20


def test_processes_of_a_run_can_be_started_by_hand(tmp_path: Path) -> None:
    duration_s = 1.0
    scenario = ("lane_change", "--set=convoy.vehicles=2", f"--set=duration_s={duration_s}")
    with ExitStack() as stack:

        def start_part(*arguments: object) -> Process:
            return stack.enter_context(start(*arguments, folder=tmp_path))

        router = start_part("router", "--listen", "tcp/127.0.0.1:0", "--until-empty")
        assert until(lambda: router.out.startswith(LISTENING)), router.err
        endpoint = router.out.removeprefix(LISTENING).strip()
        recorder = start_part("record", *scenario, "--connect", endpoint, "--out", "run", "--quiet")
        vehicles = [
            start_part("vehicle", *scenario, "--name", name, "--connect", endpoint)
            for name in ("v1", "v2")
        ]
        for part in (recorder, *vehicles, router):
            assert part.wait() == 0, part.err
        assert not recorder.err + router.err
        for name, vehicle in zip(("v1", "v2"), vehicles, strict=True):
            joined, *driven = vehicle.lines()
            assert joined.startswith(f"{name}: joined, waiting for the ")
            assert driven == [f"{name}: run lane_change {what}" for what in ("starts", "is over")]
        assert until(lambda: not any(part.remaining() for part in (recorder, *vehicles, router)))
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert_nothing_missing(run, duration_s)
    assert_summary_is_in_the_log(run)
    assert run.summary["outcome"] == "completed"
