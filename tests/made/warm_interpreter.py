"""A process that has imported the project, and forks `convoy` commands.

A new interpreter imports for 0.6 s of processor time, most of what a short command costs. A forked
command has its own session, output, environment, working folder and arguments.
"""

import ctypes
import gc
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import IO, Any

from scenarios.cli import launching, recorder_run, wall_clock_run
from scenarios.cli.__main__ import main as run_command
from scenarios.cli.main import cli
from scenarios.runs.processes import vehicle_process
from transport.bus import zenoh_bus

ROOT = Path(__file__).parents[2]
MARK = "CONVOY_TEST_MARK"
"""Environment variable that all descendants of a command inherit, to find them by."""
NO_MARK = 32 * "-"
POLL_S = 0.01
PRELOADED = (cli, launching, recorder_run, vehicle_process, wall_clock_run, zenoh_bus)
"""What commands import when they run."""


class ForkedCommand:
    """A forked command with the methods of `subprocess.Popen` that tests use."""

    def __init__(self, interpreter: "WarmInterpreter", pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._interpreter = interpreter

    def poll(self) -> int | None:
        if self.returncode is None:
            self.returncode = self._interpreter.request({"ended": self.pid})
        return self.returncode

    def wait(self, timeout: float = 60.0) -> int:
        end = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("convoy", timeout)
            time.sleep(POLL_S)
        return code

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


class WarmInterpreter:
    """The process that forks commands; it ends with this one."""

    def __init__(self) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                cwd=ROOT,
                env={**os.environ, MARK: NO_MARK},
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
            )
        self._file = ours.makefile("rw")

    def request(self, values: Mapping[str, object]) -> Any:
        self._file.write(json.dumps(values) + "\n")
        self._file.flush()
        return json.loads(self._file.readline())

    def start(
        self, arguments: Sequence[str], folder: Path, out: Path, err: Path, env: Mapping[str, str]
    ) -> ForkedCommand:
        """Fork `convoy ARGUMENTS`; `env` has its mark."""
        out.touch()
        err.touch()
        files = {"folder": str(folder), "out": str(out), "err": str(err)}
        pid = self.request({"arguments": list(arguments), "env": dict(env), **files})
        return ForkedCommand(self, pid)


@cache
def warm_interpreter() -> WarmInterpreter:
    """The one of this process."""
    return WarmInterpreter()


def set_mark(mark: str) -> None:
    """Write a mark where other processes read the environment of this one."""
    getenv = ctypes.CDLL(None).getenv
    getenv.restype = ctypes.c_void_p
    ctypes.memmove(getenv(MARK.encode()), mark.encode(), len(NO_MARK))


def fork(request: Mapping[str, Any]) -> int:
    """Fork a process with the mark of a command."""
    set_mark(request["env"][MARK])
    pid = os.fork()
    if pid:
        set_mark(NO_MARK)
    return pid


def exit_code(pid: int) -> int | None:
    ended, status = os.waitpid(pid, os.WNOHANG)
    return os.waitstatus_to_exitcode(status) if ended else None


def become(request: Mapping[str, Any]) -> None:
    """Take the session, files, environment, folder and arguments of a command."""
    os.setsid()
    for number, name in ((1, "out"), (2, "err")):
        opened = os.open(request[name], os.O_WRONLY)
        os.dup2(opened, number)
        os.close(opened)
    os.environ.clear()
    os.environ.update(request["env"])
    os.chdir(request["folder"])
    sys.argv = ["convoy", *request["arguments"]]
    sys.orig_argv = [sys.executable, "-m", "scenarios.cli", *request["arguments"]]


def serve(file: IO[str]) -> Mapping[str, Any] | None:
    """Answer requests until their end; return the request of a forked command in its process."""
    for line in file:
        request = json.loads(line)
        answer = exit_code(request["ended"]) if "ended" in request else fork(request)
        if answer == 0 and "ended" not in request:
            return request  # type: ignore[no-any-return]
        file.write(json.dumps(answer) + "\n")
        file.flush()
    return None


def main() -> None:
    gc.freeze()
    with (
        socket.socket(fileno=int(sys.argv[1])) as connection,
        connection.makefile("rw") as file,
    ):
        request = serve(file)
    if request is not None:
        become(request)
        run_command()


if __name__ == "__main__":
    main()
