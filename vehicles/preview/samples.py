"""The window of samples around the ego, the settings of a trace, and reachability checks."""

from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.sparse_path import drivable
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
