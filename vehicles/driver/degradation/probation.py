"""How long a source that came back has to behave before it is relied on again."""

from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.schedule import SECOND


class Probation:
    """Doubles with each relapse, and halves after each time without one.

    As PX4's estimator EKF2 does with its sensors: the time grows while failing and shrinks while
    passing.
    """

    def __init__(self, settings: DegradationSettings) -> None:
        self._settings = settings
        self._next = settings.probation
        self._trusted_at: int | None = None
        self._began_at = 0
        self.length = settings.probation

    def fail(self, now: int) -> None:
        """Count that the source was lost at `now` (ns), or is not believed."""
        settings = self._settings
        if self._trusted_at is not None:
            healthy = (now - self._trusted_at) / SECOND
            halvings = min(int(healthy / settings.forgiven_after), 64)
            self._next = max(self._next * 0.5**halvings, settings.probation)
            self._trusted_at = None
        self.length = self._next
        self._next = min(2.0 * self.length, max(settings.probation_max, settings.probation))

    def begin(self, now: int) -> None:
        """Begin at `now` (ns), when the source is heard again."""
        self._began_at = now

    def served(self, now: int) -> float:
        """Time (s) of it that has passed at `now` (ns)."""
        return (now - self._began_at) / SECOND

    def end(self, now: int) -> None:
        """Rely on the source again from `now` (ns) on."""
        self._trusted_at = now
