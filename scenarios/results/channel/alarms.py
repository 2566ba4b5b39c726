"""How often a follower counted a source as lost though it sent, against what its link predicts."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from scenarios.definition.check.alarms import FalseAlarms
from scenarios.results.channel.estimates import CERTAINTY, CONFIDENCE, Interval, number
from vehicles.messages import SourceStatus

MOST_ALARMS = 100_000
"""Instants of alarms that are kept of a link."""
DIGITS = 9
"""Significant digits of what is predicted: beyond them machines differ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSummary:
    """False alarms of a link: predicted for the messages sent, and counted.

    Not predicted where no number says them beforehand, or the link or its ends were changed; not
    counted where nobody says what is made of the source. The ends are those of the interval of 95 %
    of the expectation, by the count.
    """

    predicted: float | None = None
    counted: int | None = None
    low: float | None = None
    high: float | None = None


@dataclass(slots=True)
class AlarmTally:
    """What a follower made of a source: when it began to count it as lost."""

    instants: list[int] = field(default_factory=list)
    _status: SourceStatus = "unheard"
    _is_said: bool = False

    def add(self, at: int, status: SourceStatus) -> None:
        """Take what is made of the source at instant `at` (ns)."""
        is_lost = status == "lost" != self._status
        if is_lost and len(self.instants) < MOST_ALARMS:
            self.instants.append(at)
        self._is_said |= status != "unheard"
        self._status = status

    def counted(self, until: int) -> int | None:
        """Alarms up to an instant (ns) at which the sender still lived, None if nobody tells."""
        if not self._is_said:
            return None
        return sum(at <= until for at in self.instants)


def alarm_summary(law: FalseAlarms | None, sent: int, counted: int | None) -> AlarmSummary:
    """Put prediction and count of a link together of which `sent` messages were recorded."""
    expected = None if law is None else law.of_run(sent)
    found = _interval(law, counted, CONFIDENCE)
    return AlarmSummary(
        predicted=None if expected is None else float(f"{expected:.{DIGITS}g}"),
        counted=counted,
        low=found.low if found else None,
        high=found.high if found else None,
    )


def _interval(law: FalseAlarms | None, counted: int | None, confidence: float) -> Interval | None:
    """Interval of the expectation by the count, as wide as the law's swarms of alarms make it."""
    if counted is None:
        return None
    dispersion = 1.0 if law is None else float(f"{law.dispersion:.{DIGITS}g}")
    return number(counted, confidence, dispersion)


def alarm_miss(
    link: tuple[str, str], law: FalseAlarms | None, summary: AlarmSummary
) -> Iterator[str]:
    """Say that a link had other alarms than predicted, beyond the interval of 99.99 %."""
    found = _interval(law, summary.counted, CERTAINTY)
    if found is None or summary.predicted is None:
        return
    if not found.low <= summary.predicted <= found.high:
        sender, receiver = link
        yield (
            f"{sender} → {receiver}: counted as lost {summary.counted} times though it sends, "
            f"{found.low:.3g} to {found.high:.3g} with certainty, predicted {summary.predicted:.3g}"
        )
