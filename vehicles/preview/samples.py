"""Samples of a source, their window around the ego, and the constants of a trace."""

from dataclasses import dataclass
from math import hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.schedule import SECOND

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TraceSettings:
    """Constants of a trace (m unless said otherwise), none of them in Section III-A.

    A sample is kept if it is at least `spacing` further along than the one before: a stopped source
    repeats a place, and a fix may lie behind another.
    A fix is a jump if it lies further from the newest one than `jump_ratio` (1) times what its
    speed allows plus `jump_margin`; `restart_after` consistent ones in a row are a new place.
    The ego's station moves per call at most `back` backwards, and forwards at most `margin` plus
    `reach_ratio` (1) times the distance the ego moved, never more than `reach`. Samples further
    behind than `memory` are dropped, and never more than `capacity` are held. A window holds at
    most `window_samples`, and at least `least_samples` where a source is heard so rarely that fewer
    lie in it: half of them ahead, as far as there are any. A bridge has a point every
    `bridge_spacing` and at most `bridge_length`; where a source was lost for at least `hole`, it is
    bridged, too.
    """

    spacing: float = 0.2
    jump_margin: float = 3.0
    jump_ratio: float = 1.5
    restart_after: int = 3
    back: float = 2.0
    margin: float = 2.0
    reach: float = 10.0
    reach_ratio: float = 1.5
    memory: float = 100.0
    capacity: int = 20_000
    window_samples: int = 40
    least_samples: int = 4
    bridge_spacing: float = 1.0
    bridge_length: float = 500.0
    hole: float = 5.0


class Sample(NamedTuple):
    """One received fix: instant (ns), world position (m), yaw (rad), speed (m/s).

    (x_i, y_i) of Section III-A, with heading and speed, which are communicated as well (Section I).
    """

    measured_at: int
    east: float
    north: float
    yaw: float
    speed: float


class Window(NamedTuple):
    """Samples around the ego in order of travel, arrays of one length (Section III-A, Fig. 3).

    World position (m); `station` (m) is arc length from the ego's projection, negative behind it.
    """

    east: Floats
    north: Floats
    station: Floats


def plausible(one: Sample, other: Sample, settings: TraceSettings) -> bool:
    """Whether a car could have been at both places at their instants."""
    span = abs(other.measured_at - one.measured_at) / SECOND
    reach = settings.jump_ratio * max(abs(one.speed), abs(other.speed)) * span
    distance = hypot(other.east - one.east, other.north - one.north)
    return distance <= reach + settings.jump_margin
