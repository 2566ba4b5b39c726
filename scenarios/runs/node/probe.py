"""Memory, processor time and lateness of a vehicle; in virtual time all of them are zero."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Usage:
    """Resident memory, share of one core since the start, and late ticks."""

    memory_bytes: int = 0
    cpu_ratio: float = 0.0
    late_ticks: int = 0
    lateness_ms_max: float = 0.0


class Probe(Protocol):
    def read(self) -> Usage: ...


class NoProbe:
    """For virtual time, where a vehicle has no process of its own and no tick is late."""

    def read(self) -> Usage:
        return Usage()
