"""Memory, processor time and lateness of a vehicle; in virtual time all of them are zero."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Usage:
    """Resident memory, share of one core since the start, late ticks, and the process's clock.

    Late ticks with neither of the two causes are due to the processor. The offset of the clock from
    the recorder's was removed, up to the uncertainty.
    """

    memory_bytes: int = 0
    cpu_ratio: float = 0.0
    late_ticks: int = 0
    lateness_ms_max: float = 0.0
    clock_offset_ms: float = 0.0
    clock_uncertainty_ms: float = 0.0
    late_ticks_at_start: int = 0
    late_ticks_by_network: int = 0


class Probe(Protocol):
    def read(self) -> Usage: ...


class NoProbe:
    """For virtual time, where a vehicle has no process of its own and no tick is late."""

    def read(self) -> Usage:
        return Usage()
