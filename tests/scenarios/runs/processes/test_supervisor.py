"""The watch over real children: routers, which are the quickest of our own processes to start."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from multiprocessing import forkserver
from pathlib import Path

import psutil
import pytest

from scenarios.cli.run_commands import run_part
from scenarios.runs.processes.supervisor import LISTENING, Child, Supervisor, describe
from tests.made.ended import has_ended
from transport.bus.bus import BusError

SOON_S = 15.0
PIPE_BYTES = 65536
ROUTER = ("router", "--parent-watch", "-l", "tcp/127.0.0.1:0")
LAUNCHER = """
import time
from scenarios.cli.run_commands import run_part
from scenarios.runs.processes.supervisor import Supervisor
supervisor = Supervisor(run_part)
endpoint = supervisor.start_router()
print(supervisor.children[0].process.pid, endpoint, flush=True)
time.sleep(60.0)
"""


@pytest.fixture
def supervisor() -> Iterator[Supervisor]:
    one = Supervisor(run_part)
    started: list[Child] = []
    spawn = one.start

    def start(name: str, arguments: tuple[str, ...], *, piped: bool = False) -> Child:
        child = spawn(name, arguments, piped=piped)
        started.append(child)
        return child

    one.start = start  # type: ignore[assignment,method-assign]
    yield one
    for child in (*started, *one.children):
        child.process.kill()
        child.process.join()
        for stream in (child.stdin, child.stdout):
            if stream:
                with suppress(OSError):  # without a reader nothing can be written
                    stream.close()


def until(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + SOON_S
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def is_up(endpoint: str) -> bool:
    host, port = endpoint.removeprefix("tcp/").split(":")
    try:
        with socket.create_connection((host, int(port)), timeout=1.0):
            return True
    except OSError:
        return False


def pid_of(child: Child) -> int:
    assert child.process.pid is not None
    return child.process.pid


def catches(pid: int, number: int) -> bool:
    """Whether the process has come so far that it handles a signal itself (Linux)."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    caught = next(line for line in status if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) & 1 << (number - 1))


def test_a_router_listens_on_a_port_of_its_own(supervisor: Supervisor) -> None:
    endpoint = supervisor.start_router()
    router = supervisor.children[0]
    assert endpoint.startswith("tcp/127.0.0.1:")
    assert not endpoint.endswith(":0")
    assert is_up(endpoint)
    assert supervisor.ended() == []
    assert router.exit_code is None
    assert describe(router) == "router still runs"
    # A Ctrl-C in the terminal must reach the launcher alone.
    assert os.getsid(pid_of(router)) == router.process.pid
    # Asked to stop it does so by itself, with the exit code of the signal.
    assert supervisor.stop() == []
    assert router.exit_code == 143
    assert describe(router) == "router ended with exit code 143"
    assert not is_up(endpoint)
    assert supervisor.children == []


def test_failures_are_noticed_reasons_sent_and_hung_children_killed(supervisor: Supervisor) -> None:
    killed, results, orphan, stubborn = (
        supervisor.start(name, ROUTER) for name in ("killed", "informed", "orphan", "stubborn")
    )
    for child in (killed, results, orphan, stubborn):
        until(lambda child=child: catches(pid_of(child), signal.SIGTERM))  # type: ignore[misc]
    killed.process.kill()
    until(lambda: killed.exit_code is not None)
    assert supervisor.ended() == [killed]
    assert describe(killed) == "killed was killed by signal 9"
    assert supervisor.ended() == []  # informed once

    supervisor.send_reason("informed", "v2 failed")
    supervisor.send_reason("killed", "too late")
    supervisor.send_reason("nobody", "nothing happens")
    until(lambda: results.exit_code is not None)
    assert describe(results) == "informed ended with exit code 1"
    supervisor.send_reason("informed", "has ended, nothing happens")

    assert orphan.stdin is not None
    orphan.stdin.close()
    until(lambda: orphan.exit_code is not None)
    assert describe(orphan) == "orphan ended with exit code 1"
    assert supervisor.ended() == [results, orphan]

    os.kill(pid_of(stubborn), signal.SIGSTOP)  # ignores SIGTERM
    assert supervisor.stop(["someone else"]) == []
    assert stubborn.exit_code is None
    began = time.monotonic()
    assert supervisor.stop(["stubborn"], grace_s=0.3) == [stubborn]
    assert 0.3 <= time.monotonic() - began < 3.0
    assert describe(stubborn) == "stubborn was killed by signal 9"
    assert supervisor.children == []


def test_a_child_that_cannot_do_its_work_ends_by_itself(supervisor: Supervisor) -> None:
    child = supervisor.start("nonsense", ("vehicle", "nonsense", "--name", "v1"))
    until(lambda: child.exit_code is not None)
    assert supervisor.ended() == [child]
    assert describe(child) == "nonsense ended with exit code 2"
    assert supervisor.stop() == []


def test_a_router_that_logs_starts_and_is_not_blocked_by_its_log(
    supervisor: Supervisor, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RUST_LOG", "trace")
    forkserver._forkserver._stop()  # type: ignore[attr-defined] # the next one has it
    endpoint = supervisor.start_router()
    logged = 0

    def more_than_a_pipe_holds() -> bool:
        nonlocal logged
        assert is_up(endpoint)
        assert supervisor.ended() == []
        logged += len(capfd.readouterr().err)
        return logged > 2 * PIPE_BYTES

    until(more_than_a_pipe_holds)
    assert supervisor.stop() == []
    assert LISTENING not in capfd.readouterr().out


def end_at_once(_arguments: Sequence[str]) -> None:
    raise SystemExit(1)


def test_a_router_that_does_not_start_is_reported_in_one_line() -> None:
    with pytest.raises(BusError, match="the router did not start"):
        Supervisor(end_at_once).start_router()


def test_a_killed_launcher_leaves_no_process_behind() -> None:
    launcher = subprocess.Popen([sys.executable, "-c", LAUNCHER], stdout=subprocess.PIPE, text=True)
    with launcher:
        assert launcher.stdout is not None
        pid, endpoint = launcher.stdout.readline().split()
        router = psutil.Process(int(pid))
        assert is_up(endpoint)
        launcher.kill()
        launcher.wait(SOON_S)
    killed_at = time.monotonic()
    until(lambda: has_ended(router))
    assert time.monotonic() - killed_at < 5.0
