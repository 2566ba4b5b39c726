"""What a process of a run uses of its machine; a simulation replaces it."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from scenarios.runs.node.process_probe import Lateness, ProcessProbe
from transport.bus.bus import Bus
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.clock import SYSTEM_TIME, SystemTime

LONGEST_NAME = 15
"""Longest process name that the system keeps."""
MakeProbe = Callable[[int, Lateness | None, Callable[[], tuple[int, int]]], ProcessProbe]
"""Makes the probe of a process, with the first three arguments of `ProcessProbe`."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Time, bus, and measurements of the own process."""

    time: SystemTime = SYSTEM_TIME
    open_bus: Callable[[ZenohOptions], Bus] = open_bus
    make_probe: MakeProbe = ProcessProbe


THIS_MACHINE = Machine()


def name_process(name: str) -> None:
    """Show this process as `convoy-NAME` in `top`, `ps -o comm` and `pgrep`, where supported."""
    with suppress(OSError):
        Path("/proc/self/comm").write_text(f"convoy-{name}"[:LONGEST_NAME], encoding="utf-8")
