"""The window of samples around the ego, the settings of a trace, and reachability checks."""

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.sparse_path import drivable
from vehicles.preview.received.polyline import Polyline
from vehicles.received_pose import ReceivedPose

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSettings:
    """Constants of a trace (m unless stated otherwise), none of them in Section III-A.

    A sample is kept if it lies at least `spacing` beyond the previous one: a stopped source repeats
    its position, and a fix may lie behind another. Per call the ego's station moves back by at most
    `back`, and forward by at most `margin` plus `reach_ratio` (1) times the distance the ego moved,
    never more than `reach`. Samples further behind than `memory` are dropped; at most `capacity`
    are held. A window holds at most `max_samples`. Where messages are rare it is widened to
    `min_samples`, half of them ahead if available. A bridge has a point every `bridge_spacing` and
    is at most `bridge_length` long; a loss of the source over at least `hole` is bridged, too.
    """

    spacing: float = 0.2
    back: float = 2.0
    margin: float = 2.0
    reach: float = 10.0
    reach_ratio: float = 1.5
    memory: float = 100.0
    capacity: int = 20_000
    max_samples: int = 40
    min_samples: int = 4
    bridge_spacing: float = 1.0
    bridge_length: float = 500.0
    hole: float = 5.0


class Window(NamedTuple):
    """Samples around the ego in order of travel, arrays of one length (Section III-A, Fig. 3).

    World position (m); `station` (m) is arc length from the ego's projection, negative behind it.
    """

    east: Floats
    north: Floats
    station: Floats


def reachable(first: ReceivedPose, second: ReceivedPose) -> bool:
    """Whether one car can have been at both positions at their instants."""
    distance = hypot(second.east - first.east, second.north - first.north)
    speed = max(abs(first.speed), abs(second.speed))
    return drivable(distance, abs(second.measured_at - first.measured_at), speed)


def window_around(
    line: Polyline, ego: float, behind: float, ahead: float, settings: TraceSettings
) -> Window:
    """Samples from `behind` to `ahead` (m of travel) of the ego's station (m).

    The preview data of Section III-A, which sorts by distance and keeps none behind.

    With `behind` > 0 the nearest sample behind the ego is always included: a curve through
    samples ahead is extrapolated to the ego and may pass metres from it. Fewer than
    `min_samples` are supplemented by the next ones on both sides. More than `max_samples` are
    thinned to every second, fourth, … sample, always the same ones while the ego moves.
    """
    first = bisect_left(line.station, ego - behind)
    if behind > 0.0:
        first = min(first, max(bisect_right(line.station, ego) - 1, 0))
    last = bisect_right(line.station, ego + ahead)
    if last - first < settings.min_samples:
        first, last = _widened(line, ego, first, last, settings.min_samples)
    stride = 1 << (max(last - first - 1, 0) // settings.max_samples).bit_length()
    first += -(first + line.dropped) % stride
    chosen = slice(first, last, stride)
    return Window(
        np.array(line.east[chosen], dtype=np.float64),
        np.array(line.north[chosen], dtype=np.float64),
        np.array(line.station[chosen], dtype=np.float64) - ego,
    )


def _widened(line: Polyline, ego: float, first: int, last: int, count: int) -> tuple[int, int]:
    """Include the next samples on either side of the ego, `count` in total if there are any."""
    index, half = bisect_left(line.station, ego), count // 2
    last = max(last, min(index + half, len(line.at)))
    return max(min(first, last - count, index - half), 0), last
