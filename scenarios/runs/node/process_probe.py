"""Memory, processor time and lateness of this process."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic, process_time

import psutil

from scenarios.runs.node.probe import Usage
from vehicles.schedule import MILLISECOND


@dataclass(frozen=True, slots=True)
class Lateness:
    """Number of late ticks, and the largest delay (ns)."""

    ticks: int = 0
    worst_ns: int = 0


class ProcessProbe:
    """Measures this process and counts late ticks of its loop."""

    def __init__(
        self,
        late_after_ns: int,
        before: Lateness | None = None,
        clock: Callable[[], tuple[int, int]] = lambda: (0, 0),
    ) -> None:
        """Ticks later than `late_after_ns` are late; `before` holds those of an earlier process.

        `clock` returns offset and uncertainty of the process's clock (ns).
        """
        before = before or Lateness()
        self._late_after_ns = late_after_ns
        self._clock = clock
        self._process = psutil.Process()
        self._used, self._read_at = process_time(), monotonic()
        self._late_ticks = before.ticks
        self._lateness_ns_max = before.worst_ns

    @property
    def lateness(self) -> Lateness:
        return Lateness(self._late_ticks, self._lateness_ns_max)

    def tick_began(self, lateness_ns: int) -> None:
        self._late_ticks += lateness_ns > self._late_after_ns
        self._lateness_ns_max = max(self._lateness_ns_max, lateness_ns)

    def read(self) -> Usage:
        """Memory now, share of one core since the last reading, lateness since the start."""
        used, now = process_time(), monotonic()
        share = (used - self._used) / (now - self._read_at) if now > self._read_at else 0.0
        self._used, self._read_at = used, now
        offset, uncertainty = self._clock()
        return Usage(
            memory_bytes=self._process.memory_info().rss,
            cpu_ratio=share,
            late_ticks=self._late_ticks,
            lateness_ms_max=self._lateness_ns_max / MILLISECOND,
            clock_offset_ms=offset / MILLISECOND,
            clock_uncertainty_ms=uncertainty / MILLISECOND,
        )
