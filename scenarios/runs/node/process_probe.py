"""Memory, processor time and lateness of this process."""

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, monotonic_ns, process_time, thread_time_ns
from typing import Literal, NamedTuple

import psutil

from scenarios.runs.node.outbox import Usage
from transport.bus.bus import Bus
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.clock import SYSTEM_TIME, SystemTime
from vehicles.schedule import MILLISECOND

LateCause = Literal["start", "network", "processor"]


@dataclass(frozen=True, slots=True)
class Lateness:
    """Number of late ticks, the largest delay (ns), and the number of those by two causes."""

    ticks: int = 0
    worst_ns: int = 0
    at_start: int = 0
    by_network: int = 0


class ThreadTimes(NamedTuple):
    """Time, time on a processor, and time of waiting for one (ns) of the calling thread."""

    now: int
    used: int
    waited: int


class SchedulerTimes:
    """Reads the times of the calling thread; without Linux's figures it never waits."""

    def __init__(self) -> None:
        self._file = -1
        with suppress(OSError):
            self._file = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)

    def __call__(self) -> ThreadTimes:
        waited = 0
        if self._file >= 0:
            with suppress(OSError, ValueError, IndexError):
                waited = int(os.pread(self._file, 100, 0).split()[1])
        return ThreadTimes(monotonic_ns(), thread_time_ns(), waited)

    def __del__(self) -> None:
        if self._file >= 0:
            os.close(self._file)


class Resources(NamedTuple):
    """Time (s), time on processors (s) and resident memory of a process."""

    at: float
    used: float
    memory_bytes: int


class ProcessResources:
    """Reads the resources of this process."""

    def __init__(self) -> None:
        self._process = psutil.Process()

    def __call__(self) -> Resources:
        return Resources(monotonic(), process_time(), self._process.memory_info().rss)


class ProcessProbe:
    """Measures this process and counts late ticks of its loop.

    A backlog of late ticks has the cause of its first one: a late start, if that is the first tick
    of the process; the network, if the step before was blocked for most of its time, as sending can
    be; else the processor.
    """

    def __init__(
        self,
        late_after_ns: int,
        before: Lateness | None = None,
        clock: Callable[[], tuple[int, int]] = lambda: (0, 0),
        times: Callable[[], ThreadTimes] | None = None,
        resources: Callable[[], Resources] | None = None,
    ) -> None:
        """Ticks later than `late_after_ns` are late; `before` holds those of an earlier process.

        `clock` returns offset and uncertainty of the process's clock (ns); `times` are those of the
        calling thread, `resources` those of this process.
        """
        before = before or Lateness()
        self._late_after_ns = late_after_ns
        self._clock = clock
        self._resources = resources or ProcessResources()
        self._before = self._resources()
        self._late_ticks = before.ticks
        self._lateness_ns_max = before.worst_ns
        self._at_start, self._by_network = before.at_start, before.by_network
        self._times = times or SchedulerTimes()
        self._cause: LateCause | None = "start"
        self._began: ThreadTimes | None = None
        self._was_blocked = False

    @property
    def lateness(self) -> Lateness:
        return Lateness(self._late_ticks, self._lateness_ns_max, self._at_start, self._by_network)

    def tick_began(self, lateness_ns: int) -> None:
        if lateness_ns > self._late_after_ns:
            self._late_ticks += 1
            self._cause = self._cause or ("network" if self._was_blocked else "processor")
            self._at_start += self._cause == "start"
            self._by_network += self._cause == "network"
        else:
            self._cause = None
        self._lateness_ns_max = max(self._lateness_ns_max, lateness_ns)
        self._began = self._times()

    def tick_ended(self) -> None:
        """Note whether the step was blocked: neither on a processor nor waiting for one."""
        if self._began is None:  # a tick that does not count
            return
        spent, used, waited = (
            end - begin for begin, end in zip(self._began, self._times(), strict=True)
        )
        blocked = spent - used - waited
        self._was_blocked = blocked > max(used + waited, self._late_after_ns)
        self._began = None

    def read(self) -> Usage:
        """Memory now, share of one core since the last reading, lateness since the start."""
        before, self._before = self._before, self._resources()
        now = self._before
        share = (now.used - before.used) / (now.at - before.at) if now.at > before.at else 0.0
        offset, uncertainty = self._clock()
        return Usage(
            memory_bytes=now.memory_bytes,
            cpu_ratio=share,
            late_ticks=self._late_ticks,
            lateness_ms_max=self._lateness_ns_max / MILLISECOND,
            clock_offset_ms=offset / MILLISECOND,
            clock_uncertainty_ms=uncertainty / MILLISECOND,
            late_ticks_at_start=self._at_start,
            late_ticks_by_network=self._by_network,
        )


# ---- What a process of a run uses of its machine; a simulation replaces it


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
