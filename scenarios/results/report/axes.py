"""Scales and ticks of the plots."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
MARGIN_RATIO = 0.06
STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Scale:
    """Linear map from values `low` to `high` to pixels `first` to `last`."""

    low: float
    high: float
    first: float
    last: float

    def to_pixels(self, values: Floats) -> Floats:
        span = (self.high - self.low) or 1.0
        pixels: Floats = self.first + (values - self.low) / span * (self.last - self.first)
        return pixels

    def pixel(self, value: float) -> float:
        return float(self.to_pixels(np.array([value]))[0])

    def ticks(self, count: int) -> list[float]:
        """About `count` multiples of 1, 2 or 5 times a power of ten within the range."""
        span = self.high - self.low
        if not span > 0.0:
            return [self.low]
        raw = span / count
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(factor * power for factor in STEPS if factor * power >= raw * 0.999)
        first = math.ceil(self.low / step - 1e-9)
        last = math.floor(self.high / step + 1e-9)
        return [number * step for number in range(first, last + 1)]


def value_range(values: list[Floats]) -> tuple[float, float]:
    """Range of all finite values and zero, with a margin."""
    finite = [part[np.isfinite(part)] for part in values]
    known = np.concatenate([np.zeros(1), *finite])
    low, high = float(known.min()), float(known.max())
    margin = MARGIN_RATIO * ((high - low) or 1.0)
    return (low - margin if low < 0.0 else low), high + margin


def thinned(at: Floats, values: Floats, most: int) -> tuple[Floats, Floats]:
    """Keep the least and the largest value of each of `most` / 2 equal parts, and the ends.

    Extremes are kept exactly. NaN is kept as a break of the line.
    """
    if at.size <= most:
        return at, values
    width = -(-at.size // max(most // 2, 1))
    parts = -(-at.size // width)
    padded = np.full(parts * width, np.inf)
    padded[: at.size] = values
    table = padded.reshape(parts, width)
    unknown = np.isnan(table)
    first = np.arange(parts) * width
    least = first + np.where(unknown, np.inf, table).argmin(axis=1)
    largest = first + np.where(unknown | np.isinf(table), -np.inf, table).argmax(axis=1)
    breaks = (first + unknown.argmax(axis=1))[unknown.any(axis=1)]
    rows = np.unique(np.concatenate([[0, at.size - 1], least, largest, breaks]))
    return at[rows], values[rows]
