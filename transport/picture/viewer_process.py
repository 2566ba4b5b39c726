"""Rerun's own programs as processes of this machine: the web page and the native viewer.

The options of every command come from here too, so that what only a viewer needs is loaded late.
"""

import importlib.util
import json
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from transport.clock import poll

START_S = 20.0
"""A program that does not listen after this time (s) has failed."""
STOP_S = 2.0
POLL_S = 0.05
TRIES = 5
"""Ports that are tried, one after the other, if other programs take them at the same moment."""
LAYOUT_NICENESS = 10
_END_WITH_PARENT = """
import ctypes, os, sys
libc = ctypes.CDLL(None)
if hasattr(libc, "prctl"):
    libc.prctl(1, 9)
os.nice(int(sys.argv[2]))
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[3], sys.argv[3:])
"""
# PR_SET_PDEATHSIG (1) outlives exec: the kernel sends SIGKILL (9) when whoever started the program
# has ended, however it ended. Set in the new process itself, because a process with threads, which
# this one is, must run no Python between fork and exec.


class ViewerError(Exception):
    """A viewer that cannot be shown: one line with the reason and an alternative."""


def program() -> Path:
    """Find Rerun's binary: its `rerun` command is a wrapper whose child outlives it."""
    found = importlib.util.find_spec("rerun_cli")
    for folder in (found.submodule_search_locations or []) if found else []:
        binary = Path(folder) / "rerun"
        if binary.exists():
            return binary
    raise ViewerError("Rerun's viewer is not installed here: save=PATH writes a recording instead")


def start_web_page(*, address: str, port: int, data_url: str) -> "subprocess.Popen[bytes] | None":
    """Serve the page that shows `data_url` on `address`; it ends when this process does.

    That holds for SIGKILL as well. Call it from a thread that lives as long as the page is wanted,
    as the main thread does. Returns None if another program listens on the port.
    """
    flags = ["--serve-web", "--bind", address, "--web-viewer-port", str(port), data_url]
    page = _start([*_ending_with_us(), str(program()), *flags])
    if await_listening(page.pid, address, port):
        return page
    stop(page)
    if is_listening(address, port):
        return None
    raise _did_not_start(page)


def start_log_layout(
    path: Path,
    *,
    log: str,
    cars: Mapping[str, tuple[float, float, float]],
    gap_m: float,
) -> "subprocess.Popen[bytes]":
    """Write the layout for a log to `path`; see `save_log_layout`.

    It is written by a process of its own, which ends with this one, so that none has to load Rerun
    for it, and which lets others go first: nobody waits for it before the run is over. Without
    Rerun, or without room, there is no layout.
    """
    asked = {"path": str(path), "log": log, "cars": cars, "gap_m": gap_m}
    command = [sys.executable, "-m", "transport.picture.log_layout", json.dumps(asked)]
    return _start([*_ending_with_us(nice=LAYOUT_NICENESS), *command])


def require_display() -> None:
    """Raise ViewerError, with what would do instead, where no window can be opened."""
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ViewerError(
            "no display here for Rerun's viewer: serve shows it in a browser, "
            "save=PATH writes a recording"
        )


def start_native_viewer(port: int) -> "subprocess.Popen[bytes]":
    """Open the native viewer, which takes data on `port` of 127.0.0.1 and outlives this process."""
    require_display()
    flags = ["--port", str(port), "--bind", "127.0.0.1", "--expect-data-soon"]
    viewer = _start([str(program()), *flags])
    if await_listening(viewer.pid, "127.0.0.1", port):
        return viewer
    stop(viewer)
    raise _did_not_start(viewer)


def stop(process: "subprocess.Popen[bytes]") -> None:
    """End a program and wait until it has ended."""
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def free_port(address: str, preferred: int) -> int:
    """Return `preferred` if no program listens there, else some port that is free."""
    for port in (preferred, 0):
        try:
            return _bound(address, port)
        except OSError:
            continue
    raise ViewerError(f"no free port on {address}")


def listen(address: str, given: int, usual: int, serve: Callable[[int], bool]) -> int:
    """Have `serve` listen on the port `given`, or if that is 0 on the usual one or another.

    `serve` says whether it does: another program can take a port after it was found free, so that
    is tried again. Returns the port; raises ViewerError if there is none.
    """
    for _ in range(1 if given else TRIES):
        port = _take_port(address, given) if given else free_port(address, usual)
        if serve(port):
            return port
    raise ViewerError(f"{address}:{port} cannot be listened on: another program has taken it")


def _take_port(address: str, port: int) -> int:
    """Return the requested `port`; raises ViewerError if it is taken."""
    try:
        return _bound(address, port)
    except OSError as error:
        raise ViewerError(f"{address}:{port} cannot be listened on: {error.strerror}") from error


def _bound(address: str, port: int) -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        bound: int = probe.getsockname()[1]
        return bound


def quiet_environment() -> dict[str, str]:
    """Environment in which Rerun sends no usage statistics; no file of the user is changed.

    Rerun 0.41 takes CI in its environment for a machine that runs tests, and sends nothing there.
    """
    return {**os.environ, "CI": "1"}


def _ending_with_us(nice: int = 0) -> list[str]:
    """Beginning of a command that ends when this process does, and is so `nice` to others."""
    return [sys.executable, "-I", "-S", "-c", _END_WITH_PARENT, str(os.getpid()), str(nice)]


def _start(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a program in a session of its own, so that Ctrl-C does not reach it."""
    return subprocess.Popen(  # noqa: S603 - our own command line, no shell
        command,
        env=quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def await_listening(pid: int, address: str, port: int) -> bool:
    """Wait until process `pid` listens; False if it ends, or another process does so instead."""

    def settled() -> bool:
        return _has_ended(pid) or is_listening(address, port)

    poll(settled, every_s=POLL_S, at_most_s=START_S)
    return _listens(pid, port)


def _has_ended(pid: int) -> bool:
    import psutil  # noqa: PLC0415 - see above

    try:
        ended: bool = psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
    return ended


def _listens(pid: int, port: int) -> bool:
    import psutil  # noqa: PLC0415 - see above

    with suppress(psutil.Error):
        return any(
            connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
            for connection in psutil.Process(pid).net_connections("tcp")
        )
    return False


def _did_not_start(viewer: "subprocess.Popen[bytes]") -> ViewerError:
    return ViewerError(
        f"Rerun's viewer did not start (exit code {viewer.returncode}): save=PATH writes a "
        "recording instead"
    )


def is_listening(address: str, port: int) -> bool:
    """Whether a program listens there."""
    try:
        with socket.create_connection((reachable(address), port), timeout=1.0):
            return True
    except OSError:
        return False


def reachable(address: str) -> str:
    """Return the address under which this machine itself reaches a server bound to `address`."""
    return "127.0.0.1" if address == "0.0.0.0" else address  # noqa: S104 - compared, not bound
