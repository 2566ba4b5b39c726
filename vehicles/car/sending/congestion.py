"""Reactive congestion control of ETSI TS 102 687 V1.2.1, Annex A.1: the busier, the rarer."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from vehicles.schedule import MILLISECOND, nanoseconds
from vehicles.setting import Setting

BUSY_RATIOS = (0.0, 0.30, 0.40, 0.50, 0.60)
"""Channel busy ratios from which on the states of congestion control hold (TS 102 687)."""
MIN_INTERVALS = tuple(span * MILLISECOND for span in (100, 200, 400, 500, 1000))
"""Least time (ns) between two messages in each of them (TS 102 687)."""


@dataclass(frozen=True, slots=True)
class BusyRatioEntry:
    """The channel busy ratio from a time (s) after the start on."""

    at: Annotated[float, Setting("after the start", "s", 0, example=10.0)]
    busy: Annotated[float, Setting("channel busy ratio", "ratio", 0, 1, example=0.45)]


@dataclass(frozen=True, slots=True)
class CongestionControl:
    """Reactive congestion control: from a channel busy ratio of 0, 0.3, 0.4, 0.5, 0.6 on at least
    100, 200, 400, 500, 1000 ms between two messages.

    A message that is due sooner is skipped; a fix of "every_fix", and a drawn interval, wait.
    """  # noqa: D205 - one sentence

    busy: Annotated[
        tuple[BusyRatioEntry, ...], Setting("busy ratios in order of time; 0 before", nonempty=True)
    ]
    period: Annotated[
        int, Setting("between two evaluations, by one state each", "ms", 10, 10_000)
    ] = 100 * MILLISECOND

    @property
    def max_busy_ratio(self) -> float:
        """Highest busy ratio."""
        return max(one.busy for one in self.busy)

    def begin(self, start_at: int) -> "ReactiveControl":
        """Control over a run that starts at `start_at` (ns)."""
        return ReactiveControl([(one.at, one.busy) for one in self.busy], start_at, self.period)


class ReactiveControl:
    """Reactive congestion control of TS 102 687 V1.2.1, Annex A.1: least time between messages.

    The state grows with the busy ratio of the channel; each evaluation changes it by one state at
    most. It begins in the lowest.
    """

    def __init__(self, busy: Sequence[tuple[float, float]], start_at: int, period: int) -> None:
        """`busy` has times (s) and the channel busy ratio from then on; 0 before the first.

        `period` (ns) is that of the evaluations, the first at `start_at` (ns).
        """
        self._since = [start_at + nanoseconds(at) for at, _ in busy]
        self._ratios = [0.0, *(ratio for _, ratio in busy)]
        self._period = period
        self._next = start_at
        self._state = 0

    def min_interval(self, now: int) -> int:
        """Least time (ns) between two messages at `now` (ns): T_off of Table A.1, TS 102 687."""
        while self._next <= now:
            ratio = self._ratios[bisect_right(self._since, self._next)]
            wanted = bisect_right(BUSY_RATIOS, ratio) - 1
            self._state += (wanted > self._state) - (wanted < self._state)
            self._next += self._period
        return MIN_INTERVALS[self._state]


def min_interval_at(busy_ratio: float) -> int:
    """Least time (ns) between two messages in the state of that busy ratio (TS 102 687)."""
    return MIN_INTERVALS[bisect_right(BUSY_RATIOS, busy_ratio) - 1]
