"""Offsets of the vehicles' clocks from the recorder's, measured over the bus."""

from collections.abc import Callable
from dataclasses import dataclass

from transport.bus.bus import Bus
from transport.topics import clock_key
from vehicles.schedule import MILLISECOND

ROUNDS = 5
"""Number of round trips, of which the fastest counts: delays are rarely symmetric."""
TIMEOUT_S = 0.5
LONGEST_ANSWER = 20
"""Digits of an instant in nanoseconds."""

Now = Callable[[], int]


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """Offset of a vehicle's clock from the recorder's, with its uncertainty (ns)."""

    vehicle: str
    offset: int
    uncertainty: int

    def exceeds(self, limit_ms: float) -> bool:
        return abs(self.offset) - self.uncertainty > limit_ms * MILLISECOND

    def __str__(self) -> str:
        relation = "ahead of" if self.offset >= 0 else "behind"
        offset_ms, uncertainty_ms = (x / MILLISECOND for x in (abs(self.offset), self.uncertainty))
        return (
            f"the clock of {self.vehicle} is {offset_ms:.1f} ms {relation} the recorder's"
            f" (within {uncertainty_ms:.1f} ms)"
        )


def serve_clock(bus: Bus, vehicle: str, now: Now) -> None:
    bus.answer(clock_key(vehicle), lambda _: str(now()).encode())


def measure(bus: Bus, vehicle: str, now: Now) -> ClockOffset | None:
    """Measure the offset of a vehicle's clock; None without a valid answer."""
    offsets: list[ClockOffset] = []
    for _ in range(ROUNDS):
        sent_at = now()
        answer = bus.query(clock_key(vehicle), TIMEOUT_S)
        trip = now() - sent_at
        if answer is None or not answer.isdigit() or len(answer) > LONGEST_ANSWER:
            return None
        offsets.append(ClockOffset(vehicle, int(answer) - sent_at - trip // 2, trip - trip // 2))
    return min(offsets, key=lambda offset: offset.uncertainty)
