"""Stand-in of the innovation gate: believes everything."""

from dataclasses import dataclass

from vehicles.car.gnss import Fix
from vehicles.driver.degradation.settings import DegradationSettings


@dataclass(frozen=True, slots=True)
class TrustVerdict:
    """Whether a pose is believed, why not, and the accuracy (m) to assume (beyond the paper)."""

    believed: bool
    reason: str
    deviation: float


class InnovationGate:
    """Believes everything (beyond the paper)."""

    def __init__(self, settings: DegradationSettings) -> None:
        """Take the `settings` of the gate."""
        self._settings = settings

    def judge(self, now: int, fix: Fix) -> TrustVerdict:  # noqa: ARG002
        """Believe `fix`, heard at `now` (ns); beyond the paper."""
        return TrustVerdict(believed=True, reason="", deviation=fix.accuracy)
