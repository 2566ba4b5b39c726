"""Axes of the plots: value axes with at least two numbers, and time axes that align.

Rerun labels the multiples of a power of ten that are at least 20 pixels apart. The labels take
room to the left of a plot, but a view of states has none. So each time axis begins as much before
the start of the run as places the start below that of the others.
"""

import math
from typing import NamedTuple

import rerun as rr
import rerun.blueprint as rrb

MARGIN_RATIO = 0.1
MAX_STEPS = 4.0  # Largest range in labelled steps: a low plot has no room for more
PLOT_WIDTH_PX = 670.0  # Width of a plot in a window of 1600 pixels
WIDEST_LABEL_PX = 40.0
LARGEST, SMALLEST_SPAN = 1e9, 1e-9  # Limits of value axes: wrong messages may hold any number


class ValueAxis(NamedTuple):
    """Range of a value axis, and the distance of its labels."""

    low: float
    high: float
    step: float

    @classmethod
    def around(cls, low: float, high: float) -> "ValueAxis":
        """Axis that contains zero, all values from `low` to `high`, and at least two labels."""
        low, high = max(min(low, 0.0), -LARGEST), min(max(high, 0.0), LARGEST)
        span = high - low if high - low > SMALLEST_SPAN else 1.0
        step = 10.0 ** math.floor(math.log10(span))
        if span > MAX_STEPS * step:
            step *= 10.0
        if max(high, -low) < step:
            low, high = (low, step) if high >= -low else (-step, high)
        margin = MARGIN_RATIO * (high - low)
        return cls(low - margin, high + margin, step)

    @property
    def labels(self) -> list[str]:
        digits = max(0, -round(math.log10(self.step)))
        first, last = math.ceil(self.low / self.step), math.floor(self.high / self.step)
        return [f"{k * self.step:.{digits}f}" for k in range(first, last + 1)]

    @property
    def labels_px(self) -> float:
        return max(8.5 + 7.5 * (len(label) - 0.5 * ("." in label)) for label in self.labels)


def whole_run(duration_s: float | None, labels_px: float) -> rrb.TimeAxis:
    """Time axis of the whole run next to labels of a width; of all data if no duration is known."""
    if duration_s is None:
        start, end = rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite()
    else:
        lead_in_s = (WIDEST_LABEL_PX - labels_px) / PLOT_WIDTH_PX * duration_s
        start = rr.TimeRangeBoundary.absolute(seconds=-max(lead_in_s, 0.0))
        end = rr.TimeRangeBoundary.absolute(seconds=duration_s)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
