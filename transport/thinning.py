"""Thinning of topics in a log."""

from collections.abc import Mapping

from vehicles.schedule import SECOND


class Thinning:
    """Keeps the first message per period of each vehicle and topic.

    `rates_hz` are the maximum rates by topic: 0 keeps no message, a missing rate keeps all.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        self.rates_hz = dict(rates_hz)
        self._periods = {
            topic: round(SECOND / rate_hz) if rate_hz else 0 for topic, rate_hz in rates_hz.items()
        }
        self._last: dict[tuple[str, str], int] = {}

    def drops_all(self, topic: str) -> bool:
        return self._periods.get(topic) == 0

    def keeps(self, topic: str, vehicle: str, valid_at: int) -> bool:
        """Whether to keep a message that was valid at an instant (ns); call in order of time."""
        period = self._periods.get(topic)
        if period is None:
            return True
        if not period:
            return False
        number = valid_at // period
        if self._last.get((vehicle, topic)) == number:
            return False
        self._last[vehicle, topic] = number
        return True
