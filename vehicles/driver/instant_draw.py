"""Random numbers of the classes that decide in a vehicle, keyed by the control instant."""

from collections.abc import Callable

Numbers = Callable[[str, int], float]  # By purpose and time (ns) after the start, in (0, 1)


class InstantDraw:
    """Random numbers of one vehicle at the control instant `now` (ns).

    A number depends on the source of `numbers`, the class, the purpose and the time since the start
    of the run, `start_at` (ns), only, not on other draws. So a decision can be computed alone, and
    again.
    """

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.now = self.start_at = 0

    def of(self, point: str) -> Callable[[str], float]:
        """Draws of the class at a plug-in point: the number in (0, 1) of a purpose."""

        def draw(purpose: str) -> float:
            return self.numbers(f"{point} {purpose}", self.now - self.start_at)

        return draw
