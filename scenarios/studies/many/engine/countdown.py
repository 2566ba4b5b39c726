"""How far many runs have come, in a line now and then, with the time that is left."""

import time
from collections.abc import Callable

SAY_EVERY_S = 2.0


class Countdown:
    """Counts runs of `total`, of which `before` were done by another process."""

    def __init__(self, total: int, before: int, say: Callable[[str], None]) -> None:
        self._total = total
        self._done = before
        self._say = say
        self._began = self._said = time.monotonic()
        self._first: tuple[int, float] | None = None

    def one_more(self) -> None:
        """Count one run that is done; says so every few seconds, and of the last one.

        The time left is told by the runs after the first, before which the workers had to start.
        """
        self._done += 1
        now = time.monotonic()
        first, first_at = self._first = self._first or (self._done, now)
        if now - self._said < SAY_EVERY_S and self._done < self._total:
            return
        self._said = now
        text = f"{now - self._began:6.1f} s  {self._done} of {self._total} runs"
        if first < self._done < self._total:
            left_s = (now - first_at) / (self._done - first) * (self._total - self._done)
            text += f", {left_s:.0f} s left"
        self._say(text)
