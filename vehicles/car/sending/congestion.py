"""Reactive congestion control of ETSI TS 102 687 V1.2.1, Annex A.1."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from vehicles.schedule import MILLISECOND, nanoseconds
from vehicles.setting import Setting

BUSY_RATIOS = (0.0, 0.30, 0.40, 0.50, 0.60)  # Lower bound of each state (TS 102 687)
MIN_INTERVALS = tuple(span * MILLISECOND for span in (100, 200, 400, 500, 1000))
"""Minimum time (ns) between two messages in each state (TS 102 687)."""


@dataclass(frozen=True, slots=True)
class BusyRatioEntry:
    """The channel busy ratio from `at_s` on."""

    at: Annotated[float, Setting("time after the start of the run", "s", 0, example=10.0)]
    busy: Annotated[float, Setting("channel busy ratio", "ratio", 0, 1, example=0.45)]


@dataclass(frozen=True, slots=True)
class CongestionControl:
    """Reactive congestion control: a minimum interval that grows with the channel busy ratio.

    Minimum interval 100, 200, 400, 500, 1000 ms from busy ratios of 0, 0.3, 0.4, 0.5, 0.6. A
    message that is due earlier is skipped; with "every_fix" and "intervals" it waits.
    """

    busy: Annotated[
        tuple[BusyRatioEntry, ...],
        Setting(
            "busy ratios in order of time; the ratio is 0 before the first entry", nonempty=True
        ),
    ]
    period: Annotated[
        int,
        Setting(
            "period of the evaluations; the state changes by at most one per evaluation",
            unit="ms",
            minimum=10,
            maximum=10_000,
        ),
    ] = 100 * MILLISECOND

    @property
    def max_busy_ratio(self) -> float:
        return max(entry.busy for entry in self.busy)

    def begin(self, start_at: int) -> "ReactiveControl":
        """Control over a run that starts at `start_at` (ns)."""
        busy = [(entry.at, entry.busy) for entry in self.busy]
        return ReactiveControl(busy, start_at, self.period)


class ReactiveControl:
    """Reactive congestion control of TS 102 687 V1.2.1, Annex A.1: minimum time between messages.

    The state follows the channel busy ratio, by at most one state per evaluation, and starts at the
    lowest.
    """

    def __init__(self, busy: Sequence[tuple[float, float]], start_at: int, period: int) -> None:
        """Take times (s) with the busy ratio from then on; evaluate every `period` (ns)."""
        self._since = [start_at + nanoseconds(at) for at, _ in busy]
        self._ratios = [0.0, *(ratio for _, ratio in busy)]
        self._period = period
        self._next = start_at
        self._state = 0

    def min_interval(self, now: int) -> int:
        """Minimum time (ns) between messages at `now` (ns): T_off of Table A.1, TS 102 687."""
        while self._next <= now:
            ratio = self._ratios[bisect_right(self._since, self._next)]
            target = bisect_right(BUSY_RATIOS, ratio) - 1
            self._state += (target > self._state) - (target < self._state)
            self._next += self._period
        return MIN_INTERVALS[self._state]


def min_interval_at(busy_ratio: float) -> int:
    """Minimum time (ns) between messages in the state of a busy ratio (TS 102 687)."""
    return MIN_INTERVALS[bisect_right(BUSY_RATIOS, busy_ratio) - 1]
