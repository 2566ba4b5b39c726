"""Memory, processor time and lateness of a process; in virtual time all of them are zero."""

from dataclasses import dataclass
from time import monotonic, process_time
from typing import Protocol

import psutil

from vehicles.schedule import MILLISECOND


@dataclass(frozen=True, slots=True)
class Usage:
    """One reading: resident memory, share of one core since the start, ticks that came late."""

    memory_bytes: int = 0
    cpu_ratio: float = 0.0
    late_ticks: int = 0
    lateness_ms_max: float = 0.0


@dataclass(frozen=True, slots=True)
class Lateness:
    """Ticks that came late so far, and the latest of all (ns)."""

    ticks: int = 0
    worst_ns: int = 0


class Probe(Protocol):
    """A source of readings."""

    def read(self) -> Usage:
        """Take a reading."""
        ...


class NoProbe:
    """For virtual time, where a vehicle has no process of its own and no tick is late."""

    def read(self) -> Usage:
        """Return zeros."""
        return Usage()


class ProcessProbe:
    """Reads this process, and counts the ticks of its loop that came late."""

    def __init__(self, late_after_ns: int, before: Lateness | None = None) -> None:
        """A tick that begins more than `late_after_ns` after its instant is late.

        Those `before` are counted.
        """
        before = before or Lateness()
        self._late_after_ns = late_after_ns
        self._process = psutil.Process()
        self._used, self._read_at = process_time(), monotonic()
        self._late_ticks = before.ticks
        self._lateness_ns_max = before.worst_ns

    @property
    def lateness(self) -> Lateness:
        """Lateness so far."""
        return Lateness(self._late_ticks, self._lateness_ns_max)

    def tick_began(self, lateness_ns: int) -> None:
        """Count one tick."""
        self._late_ticks += lateness_ns > self._late_after_ns
        self._lateness_ns_max = max(self._lateness_ns_max, lateness_ns)

    def read(self) -> Usage:
        """Memory now, share of one core since the last reading, lateness since the start."""
        used, now = process_time(), monotonic()
        share = (used - self._used) / (now - self._read_at) if now > self._read_at else 0.0
        self._used, self._read_at = used, now
        return Usage(
            memory_bytes=self._process.memory_info().rss,
            cpu_ratio=share,
            late_ticks=self._late_ticks,
            lateness_ms_max=self._lateness_ns_max / MILLISECOND,
        )
