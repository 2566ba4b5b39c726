"""Hosts as network namespaces, each with a cable to the base; needs root and `ip`."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import IO

from tests.system.hosts.cable import CUT, MEND, READY

PROJECT = Path(__file__).parents[3]
BASE, CABLE = "base", "tests.system.hosts.cable"


@cache
def available() -> bool:
    """Whether this machine can create network namespaces and Ethernet devices."""
    if os.geteuid() != 0 or shutil.which("ip") is None or not Path("/dev/net/tun").exists():
        return False
    name = f"cv{os.getpid():x}-probe"
    created = subprocess.run(["ip", "netns", "add", name], capture_output=True, check=False)
    if created.returncode:
        return False
    _ip("netns", "del", name)
    return True


def _ip(*arguments: object) -> None:
    subprocess.run(["ip", *map(str, arguments)], check=True, capture_output=True)


@dataclass(frozen=True)
class CableControl:
    """Cuts and mends the cable of one host."""

    commands: IO[str]

    def cut(self) -> None:
        print(CUT, file=self.commands, flush=True)

    def mend(self) -> None:
        print(MEND, file=self.commands, flush=True)


class Hosts:
    """A base and further hosts, which reach each other only through it."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._prefix = f"cv{os.getpid():x}"
        self._count = 0
        self._add(BASE)

    def inside(self, host: str) -> tuple[str, ...]:
        """Beginning of a command that runs on a host."""
        return "ip", "netns", "exec", f"{self._prefix}-{host}"

    def connect(self, host: str, delay_ms: float, loss_ratio: float) -> tuple[str, CableControl]:
        """Add a host with a cable to the base; returns the address of the base, and the cable."""
        self._add(host)
        self._count += 1
        near, far = f"{self._prefix}n{self._count}", f"{self._prefix}f{self._count}"
        network = f"10.77.{self._count}"
        process = self._stack.enter_context(
            subprocess.Popen(
                [sys.executable, "-m", CABLE, near, far, str(delay_ms), str(loss_ratio)],
                cwd=PROJECT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        )
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stdout.readline().strip() == READY
        self._stack.callback(process.stdin.close)
        for device, place, last in ((near, BASE, 1), (far, host, 2)):
            namespace = f"{self._prefix}-{place}"
            _ip("link", "set", device, "netns", namespace)
            _ip("-n", namespace, "address", "add", f"{network}.{last}/24", "dev", device)
            _ip("-n", namespace, "link", "set", device, "up")
        return f"{network}.1", CableControl(process.stdin)

    def _add(self, host: str) -> None:
        namespace = f"{self._prefix}-{host}"
        _ip("netns", "add", namespace)
        self._stack.callback(_ip, "netns", "del", namespace)
        _ip("-n", namespace, "link", "set", "lo", "up")


@contextmanager
def connected_hosts() -> Iterator[Hosts]:
    """Hosts that vanish at the end, with their cables."""
    with ExitStack() as stack:
        yield Hosts(stack)
