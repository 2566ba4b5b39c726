"""The window of samples around the ego, the constants of a trace, and how far a car can come."""

from dataclasses import dataclass
from math import hypot
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.received_pose import ReceivedPose
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]
REACH_RATIO: Final = 1.5
REACH_MARGIN: Final = 3.0
"""A place is out of reach if it is further away than this ratio times the speed's distance, plus
this margin (m).
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSettings:
    """Constants of a trace (m unless stated otherwise), none of them in Section III-A.

    A sample is kept if it is at least `spacing` further along than the one before: a stopped source
    repeats a place, and a fix may lie behind another. The ego's station moves per call at most
    `back` backwards, and forwards at most `margin` plus `reach_ratio` (1) times the distance the
    ego moved, never more than `reach`. Samples further behind than `memory` are dropped, and never
    more than `capacity` are held. A window holds at most `window_samples`, and at least
    `least_samples` where messages are so rare that fewer lie in it: half of them ahead, as far as
    there are any. A bridge has a point every `bridge_spacing` and at most `bridge_length`; a loss
    of the source over at least `hole` is bridged, too.
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


def reachable(one: ReceivedPose, other: ReceivedPose) -> bool:
    """Whether a car could have been at both places at their instants."""
    distance = hypot(other.east - one.east, other.north - one.north)
    speed, span = max(abs(one.speed), abs(other.speed)), abs(other.measured_at - one.measured_at)
    return drivable(distance, span, speed)


def drivable(distance: float, span: int, speed: float) -> bool:
    """Whether a car at `speed` (m/s) can have covered `distance` (m) in `span` (ns)."""
    return distance <= REACH_RATIO * speed * (span / SECOND) + REACH_MARGIN
