"""Rerun's own programs as processes of this machine: the web page and the native viewer.

The options of every command import this module, so it imports viewers' libraries late.
"""

import importlib.util
import os
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from transport.clock import poll
from transport.texts import ConvoyError

START_S = 20.0  # Time (s) after which a program that does not listen has failed
STOP_S = 2.0
POLL_S = 0.05
PORT_TRIES = 5  # Number of free ports that are tried, in case other programs take them meanwhile
OTHER_PORTS = "choose other ports with --serve-at ADDRESS:PORT:DATA_PORT"
_END_WITH_PARENT = """
import ctypes, os, sys
libc = ctypes.CDLL(None)
if hasattr(libc, "prctl"):
    libc.prctl(1, 9)
if os.getppid() == int(sys.argv[1]):
    os.execv(sys.argv[2], sys.argv[2:])
"""
# PR_SET_PDEATHSIG (1) outlives exec: the kernel sends SIGKILL (9) when the parent has ended in any
# way. Set in the new process, because this process has threads and must run no Python between fork
# and exec.


class ViewerError(ConvoyError):
    """A viewer cannot be shown. The message is one line with the reason and an alternative."""


class UnwritableRecordingError(ViewerError):
    """The file of a recording is incomplete, for example on a full disk."""


def viewer_binary() -> Path:
    """Path of Rerun's binary; the `rerun` command is a wrapper whose child outlives it."""
    package = importlib.util.find_spec("rerun_cli")
    for folder in (package.submodule_search_locations or []) if package else []:
        binary = Path(folder) / "rerun"
        if binary.exists():
            return binary
    raise ViewerError(
        "Rerun's viewer is not installed here: --save FILE writes a recording instead"
    )


def start_web_page(*, address: str, port: int, data_url: str) -> "subprocess.Popen[bytes] | None":
    """Serve the page that shows `data_url` on `address`; it ends when this process does.

    Also by SIGKILL. Call it from a thread that outlives the page, such as the main thread. Returns
    None if another program listens on the port.
    """
    flags = ["--serve-web", "--bind", address, "--web-viewer-port", str(port), data_url]
    page = _start([*_ends_with_parent(), str(viewer_binary()), *flags])
    if await_listening(page.pid, address, port):
        return page
    stop(page)
    if is_listening(address, port):
        return None
    raise _did_not_start(page)


def require_display() -> None:
    """Raise ViewerError, with alternatives, where no window can be opened."""
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ViewerError(
            "no display here for Rerun's viewer: --serve shows it in a browser, "
            "--save FILE writes a recording"
        )


def start_native_viewer(port: int) -> "subprocess.Popen[bytes]":
    """Open the native viewer, which receives data on `port` of 127.0.0.1 and outlives this one."""
    require_display()
    flags = ["--port", str(port), "--bind", "127.0.0.1", "--expect-data-soon"]
    viewer = _start([str(viewer_binary()), *flags])
    if await_listening(viewer.pid, "127.0.0.1", port):
        return viewer
    stop(viewer)
    raise _did_not_start(viewer)


def stop(process: "subprocess.Popen[bytes]") -> None:
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def free_port(address: str, preferred: int) -> int:
    """Return `preferred` if no program listens there, else another free port."""
    for port in (preferred, 0):
        try:
            return _bound(address, port)
        except OSError:
            continue
    raise ViewerError(f"no free port on {address}")


def listen(address: str, requested: int, usual: int, serve: Callable[[int], bool]) -> int:
    """Have `serve` listen on the `requested` port or, if it is 0, on the usual or another port.

    `serve` returns whether it does: another program can take a free port meanwhile, so others are
    tried. Returns the port; raises ViewerError without one.
    """
    for _ in range(1 if requested else PORT_TRIES):
        try:
            port = _bound(address, requested) if requested else free_port(address, usual)
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            text = f"cannot listen on {address}:{requested}: {reason}; {OTHER_PORTS}"
            raise ViewerError(text) from error
        if serve(port):
            return port
    raise ViewerError(f"cannot listen on {address}:{port}: address already in use; {OTHER_PORTS}")


def _bound(address: str, port: int) -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        bound: int = probe.getsockname()[1]
        return bound


def quiet_environment() -> dict[str, str]:
    """Environment with CI set, in which Rerun 0.41 sends no usage statistics."""
    return {**os.environ, "CI": "1"}


def _ends_with_parent() -> list[str]:
    """Prefix of a command that ends with this process."""
    return [sys.executable, "-I", "-S", "-c", _END_WITH_PARENT, str(os.getpid())]


def _start(command: Sequence[str]) -> "subprocess.Popen[bytes]":
    """Start a program in its own session, which Ctrl-C does not reach."""
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
    import psutil  # noqa: PLC0415 - see above

    def settled() -> bool:
        ended = not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
        return ended or is_listening(address, port)

    with suppress(psutil.Error):
        poll(settled, every_s=POLL_S, at_most_s=START_S)
        return any(
            connection.status == psutil.CONN_LISTEN and connection.laddr.port == port
            for connection in psutil.Process(pid).net_connections("tcp")
        )
    return False


def _did_not_start(viewer: "subprocess.Popen[bytes]") -> ViewerError:
    return ViewerError(
        f"Rerun's viewer did not start (exit code {viewer.returncode}): --save FILE writes a "
        "recording instead"
    )


def is_listening(address: str, port: int) -> bool:
    try:
        with socket.create_connection((local_address(address), port), timeout=1.0):
            return True
    except OSError:
        return False


def local_address(address: str) -> str:
    """Address at which this machine reaches a server bound to `address`."""
    return "127.0.0.1" if address == "0.0.0.0" else address  # noqa: S104 - compared, not bound
