"""Which messages a log holds, where it is to hold but some of a topic."""

from collections.abc import Mapping

from vehicles.schedule import SECOND


class Thinning:
    """Keeps of each vehicle's topic the first message in every period, by when it was valid.

    So whoever asks finds the same, whatever was kept before. Topics without a rate are whole; of
    one with the rate 0 nothing is kept.
    """

    def __init__(self, rates_hz: Mapping[str, float]) -> None:
        """`rates_hz` are the highest rates of the topics that are thinned."""
        self.rates_hz = dict(rates_hz)
        self._periods = {
            topic: round(SECOND / rate_hz) if rate_hz else 0 for topic, rate_hz in rates_hz.items()
        }
        self._last: dict[tuple[str, str], int] = {}

    def drops_all(self, topic: str) -> bool:
        """Whether nothing of a topic is kept."""
        return self._periods.get(topic) == 0

    def keeps(self, topic: str, vehicle: str, valid_at: int) -> bool:
        """Whether a message is kept that was valid at an instant (ns); they come in order."""
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
