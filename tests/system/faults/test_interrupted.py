"""Interrupted commands, and commands with closed output pipes."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from scenarios.runs.processes.supervisor import LISTENING
from tests.system.logs import Run, assert_sound
from tests.system.processes import until

SOON_S = 5.0
"""A recorder waits 1 s for a frozen router; the rest is for a busy machine."""
PATIENCE_S = 60.0
NOBODY = "tcp/127.0.0.1:1"
COMMANDS: Sequence[Sequence[str]] = (
    ["run", "lane_change", "--out", "run"],
    ["run", "lane_change", "--clock", "virtual", "--set", "gnss.rate_hz=100", "--out", "run"],
    ["router", "-l", "tcp/127.0.0.1:0"],
    ["vehicle", "lane_change", "--name", "v1", "-e", NOBODY],
    ["record", "lane_change", "-e", NOBODY, "--out", "run"],
    ["check", "church_lot"],
    ["paper", "gains", "--out", "gains"],
    ["paper", "reproduce", "--out", "paper"],
)


@contextmanager
def convoy(folder: Path, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """Start `convoy ARGUMENTS` in `folder`; kill it on exit."""
    process = subprocess.Popen(
        [sys.executable, "-m", "scenarios.cli", *arguments],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            process.kill()


def has_signal_handlers(process: "subprocess.Popen[str]") -> bool:
    """Whether SIGTERM has a handler; the interpreter itself installs none."""
    for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
        if line.startswith("SigCgt:"):
            return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
    return False


def assert_ends_with_one_line(process: "subprocess.Popen[str]", number: signal.Signals) -> None:
    """Send a signal; check exit code, time, and the only error line."""
    process.send_signal(number)
    sent_at = time.monotonic()
    _, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number, errors
    assert time.monotonic() - sent_at < SOON_S
    assert errors.splitlines()[-1] == f"stopped by {number.name}"
    assert errors.count("stopped by") == 1
    assert "Traceback" not in errors


@pytest.mark.spread(5)
@pytest.mark.parametrize(("number", "after_s"), [(signal.SIGINT, 0.0), (signal.SIGTERM, 0.15)])
@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda arguments: arguments[0])
def test_a_command_ends_promptly_during_its_imports(
    arguments: Sequence[str], number: signal.Signals, after_s: float, tmp_path: Path
) -> None:
    with convoy(tmp_path, *arguments) as process:
        assert until(lambda: has_signal_handlers(process))
        time.sleep(after_s)
        assert_ends_with_one_line(process, number)


@pytest.mark.parametrize(("command", "joined"), [("vehicle", True), ("record", False)])
def test_a_command_ends_with_a_frozen_router(command: str, joined: bool, tmp_path: Path) -> None:
    own = {"vehicle": ["--name", "v1"], "record": ["--out", "run", "--quiet"]}[command]
    with convoy(tmp_path, "router", "-l", "tcp/127.0.0.1:0") as router:
        assert router.stdout is not None
        endpoint = router.stdout.readline().removeprefix(LISTENING).strip()
        if not joined:
            router.send_signal(signal.SIGSTOP)
        with convoy(tmp_path, "vehicle", "lane_change", "--name", "v2", "-e", endpoint) as other:
            # In sequence: a connection to a frozen router times out.
            assert until(lambda: is_connected(other, endpoint))
            with convoy(tmp_path, command, "lane_change", *own, "-e", endpoint) as process:
                assert until(lambda: is_connected(process, endpoint))
                time.sleep(0.8)  # they declare what they send and receive
                router.send_signal(signal.SIGSTOP)
                assert_ends_with_one_line(process, signal.SIGINT)


def is_connected(process: "subprocess.Popen[str]", endpoint: str) -> bool:
    """Whether a process has a TCP connection to the router, possibly frozen."""
    port = int(endpoint.rpartition(":")[2])
    connections = psutil.Process(process.pid).net_connections("tcp")
    return any(c.raddr and c.raddr.port == port for c in connections)


@pytest.mark.parametrize("clock", ["wall", "virtual"])
def test_a_run_continues_with_closed_output_pipes(clock: str, tmp_path: Path) -> None:
    short = ("--set=duration_s=1", "--set=convoy.vehicles=2")
    arguments = ("run", "lane_change", "--clock", clock, *short, "--out", "run")
    with convoy(tmp_path, *arguments) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        process.stderr.close()
        assert process.wait(PATIENCE_S) == 0
    run = Run(tmp_path / "run")
    assert_sound(run.log)
    assert run.summary["outcome"] == "completed"
    assert run.summary["ran_s"] == 1.0


def test_a_closed_output_pipe_is_no_error(tmp_path: Path) -> None:
    with convoy(tmp_path, "list") as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait(PATIENCE_S) == 0
        assert process.stderr is not None
        assert process.stderr.read() == ""
