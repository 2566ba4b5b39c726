"""Removal of jumps and standstills from a recorded drive."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.receiver_errors.jumps import Jump, find_jumps
from scenarios.definition.traces.receiver_errors.stands import FEWEST, Stand, stands_in
from vehicles.geometry.bridges import noise_deviation, step_lengths

CRAWL, MOVING_SHARE = 0.1, 0.99
"""Times of a car that moves have more than 1 % of the steps faster than this (m/s)."""

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Cleaned:
    """Numbers of the kept points, their positions (m, shape (2, n)), jumps and standstills.

    A standstill becomes two points at one place; one point before the first movement or after the
    last. `noise` is the standard deviation (m, per axis) of white noise, or of drift at standstill.
    """

    kept: NDArray[np.int64]
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Sequence[float] | Floats, time_error_s: float = 0.0) -> Cleaned:
    """Remove jumps and standstills from `points` (2, n) with `times` (s), empty if unknown.

    Times are late by 0 to `time_error_s`.
    """
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(np.arange(count), points)
    if _never_moves(points, np.asarray(times)):
        times = ()
    jumps, remaining = find_jumps(points, times, time_error_s)
    timed = len(times) > 0
    at = np.asarray(times)[remaining] if timed else remaining.astype(np.float64)
    stands = [
        replace(
            stand,
            first=int(remaining[stand.first]),
            last=int(remaining[stand.last]),
            core=(int(remaining[stand.core[0]]), int(remaining[stand.core[1]])),
        )
        for stand in stands_in(points[:, remaining], at, timed=timed)
    ]
    noise = max([noise_deviation(points[:, remaining]), *(stand.wander for stand in stands)])
    places = points.copy()
    is_kept = np.zeros(count, dtype=bool)
    is_kept[remaining] = True
    for stand in stands:
        starts, stops = stand.first == remaining[0], stand.last == remaining[-1]
        begun, ended = stand.core
        ends = [ended] if starts else [begun] if stops or begun == ended else [begun, ended]
        is_kept[stand.first : stand.last + 1] = False
        is_kept[ends] = True
        places[:, ends] = np.array(stand.place)[:, None]
    kept = np.flatnonzero(is_kept)
    return Cleaned(kept, places[:, kept], noise, jumps, stands)


def _never_moves(points: Floats, times: Floats) -> bool:
    """Whether times, such as those in a wrong unit, have the car stand during the whole drive."""
    steps, gone = step_lengths(points), np.diff(times)
    if not gone.size or not (gone > 0.0).any():
        return False
    speeds = steps[gone > 0.0] / gone[gone > 0.0]
    return float(np.quantile(speeds, MOVING_SHARE)) < CRAWL
