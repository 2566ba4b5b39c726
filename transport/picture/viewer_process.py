"""Rerun's own program as a process of this machine: the native viewer, or a server for browsers.

The options of every command import this module, so it imports Rerun late.
"""

import importlib.util
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from transport.clock import poll
from transport.texts import ConvoyError

START_S = 20.0  # Time (s) after which a program that does not listen has failed
STOP_S = 2.0
POLL_S = 0.05
MEMORY_LIMIT = "512MB"  # Of a server for later viewers; then the oldest data go
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


def require_display() -> None:
    """Raise ViewerError, with alternatives, where no window can be opened."""
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ViewerError(
            "no display here for Rerun's viewer: --serve shows it in a browser, "
            "--save FILE writes a recording"
        )


def start_native_viewer(port: int) -> None:
    """Open the native viewer, which receives data on `port` of 127.0.0.1 and outlives this one."""
    require_display()
    flags = ["--port", str(port), "--bind", "127.0.0.1", "--expect-data-soon"]
    _start([str(viewer_binary()), *flags], "127.0.0.1", [port])


def start_server(address: str, page_port: int, data_port: int) -> "subprocess.Popen[bytes]":
    """Serve a web page and its data on two ports of `address`; the server ends with this process.

    Also by SIGKILL. Call it from a thread that outlives the server, such as the main thread.
    """
    flags = ["--serve-web", "--bind", address, "--server-memory-limit", MEMORY_LIMIT]
    flags += ["--port", str(data_port), "--web-viewer-port", str(page_port)]
    ends_with_parent = [sys.executable, "-I", "-S", "-c", _END_WITH_PARENT, str(os.getpid())]
    command = [*ends_with_parent, str(viewer_binary()), *flags]
    return _start(command, address, [data_port, page_port])


def _start(command: Sequence[str], address: str, ports: Sequence[int]) -> "subprocess.Popen[bytes]":
    """Start a program in its own session, which Ctrl-C does not reach, and wait for its ports."""
    program = subprocess.Popen(  # noqa: S603 - our own command line, no shell
        command,
        env=quiet_environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )

    def is_ready() -> bool:
        return all(is_listening(address, port) for port in ports)

    poll(lambda: program.poll() is not None or is_ready(), every_s=POLL_S, at_most_s=START_S)
    if program.poll() is None and is_ready():
        return program
    stop(program)
    raise ViewerError(
        f"Rerun's viewer did not start (exit code {program.returncode}): --save FILE writes a "
        "recording instead"
    )


def stop(process: "subprocess.Popen[bytes]") -> None:
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def free_port(address: str, usual: int, requested: int = 0) -> int:
    """Return the `requested` port or, if it is 0, the usual port or another free one.

    Raises ViewerError if another program listens on the requested port.
    """
    for port in (requested,) if requested else (usual, 0):
        try:
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                probe.bind((address, port))
                bound: int = probe.getsockname()[1]
                return bound
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
    raise ViewerError(
        f"cannot listen on {address}:{port}: {reason}; choose other ports with --serve-at "
        "ADDRESS:PORT:DATA_PORT"
    )


def quiet_environment() -> dict[str, str]:
    """Environment with CI set, in which Rerun 0.41 sends no usage statistics."""
    return {**os.environ, "CI": "1"}


def is_listening(address: str, port: int) -> bool:
    try:
        with socket.create_connection((local_address(address), port), timeout=1.0):
            return True
    except OSError:
        return False


def local_address(address: str) -> str:
    """Address at which this machine reaches a server bound to `address`."""
    return "127.0.0.1" if address == "0.0.0.0" else address  # noqa: S104 - compared, not bound
