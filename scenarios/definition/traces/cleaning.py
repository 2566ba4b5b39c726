"""A recorded drive without what a receiver records and no car drives: jumps and stands."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.jumps import Jump, JumpFinder
from scenarios.definition.traces.stands import FEWEST, Stand, stands_in
from vehicles.geometry.bridges import scatter

Floats = NDArray[np.float64]


@dataclass(slots=True)
class Cleaned:
    """Which points are kept, by number, where they are (m, shape (2, n)), and what was found.

    A stand in the drive is two points at one place, one at its beginning and one at its end. A
    stand before the first movement is one point, as is one after the last. `noise` is the standard
    deviation (m, per axis) of the points: of their white noise, or of their wander in a stand.
    """

    kept: list[int]
    points: Floats
    noise: float = 0.0
    jumps: list[Jump] = field(default_factory=list)
    stands: list[Stand] = field(default_factory=list)


def cleaned(points: Floats, times: Sequence[float]) -> Cleaned:
    """Take jumps and stands out of `points` (2, n) with their `times` (s), () where not known."""
    count = points.shape[1]
    if count < FEWEST:
        return Cleaned(list(range(count)), points)
    track = JumpFinder(points, times)
    jumps = track.without_jumps()
    left = np.array(track.kept)
    stands = [
        replace(
            one,
            first=int(left[one.first]),
            last=int(left[one.last]),
            core=(int(left[one.core[0]]), int(left[one.core[1]])),
        )
        for one in stands_in(points[:, left], track.at[left], timed=bool(times))
    ]
    noise = max([scatter(points[:, left]), *(stand.wander for stand in stands)])
    found = Cleaned([], points.copy(), noise, jumps, stands)
    begin = 0
    for stand in [*stands, None]:
        end = stand.first if stand else count
        found.kept += [int(k) for k in left if begin <= k < end]
        if stand:
            starts, stops = stand.first == left[0], stand.last == left[-1]
            begun, ended = stand.core
            ends = (ended,) if starts else (begun,) if stops or begun == ended else stand.core
            found.kept += ends
            found.points[:, list(ends)] = np.array(stand.place)[:, None]
            begin = stand.last + 1
    found.points = found.points[:, found.kept]
    return found
