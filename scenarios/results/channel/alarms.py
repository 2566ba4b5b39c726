"""How often a follower counted a source as lost although it sent."""

from dataclasses import dataclass, field

from vehicles.messages import SourceStatus

MOST_ALARMS = 100_000
"""Instants of alarms that are kept of a link."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSummary:
    """False alarms of a link; `counted` is None where the receiver reports no status of the source.

    The other fields are those of earlier summaries, which compared the count with a prediction.
    """

    predicted: float | None = None
    counted: int | None = None
    low: float | None = None
    high: float | None = None


@dataclass(slots=True)
class AlarmTally:
    """Instants at which a follower began to count a source as lost."""

    instants: list[int] = field(default_factory=list)
    _status: SourceStatus = "unheard"
    _is_reported: bool = False

    def add(self, at: int, status: SourceStatus) -> None:
        is_lost = status == "lost" != self._status
        if is_lost and len(self.instants) < MOST_ALARMS:
            self.instants.append(at)
        self._is_reported |= status != "unheard"
        self._status = status

    def counted(self, until: int) -> int | None:
        """Count alarms up to an instant (ns) at which the sender still ran; None without status."""
        if not self._is_reported:
            return None
        return sum(at <= until for at in self.instants)
