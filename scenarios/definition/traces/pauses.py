"""Pauses of a recorded drive: standstills, and gaps in the recording that take no distance."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from scenarios.definition.traces.recorded_drive import Floats
from vehicles.geometry.bridges import step_lengths

PAUSE = 10.0
"""Shortest time (s) lost in a pause, beyond what its distance takes at the usual speed."""

PauseRule = Literal["keep", "cut"]
"""Whether the lead waits where the recorded car did not move on."""


@dataclass(frozen=True, slots=True)
class Pause:
    """A pause after point `point` of a drive, which `lost_s` are lost in.

    The step to the next point takes `lasts_s` in the record; the rest is its distance at the usual
    speed of the drive.
    """

    point: int
    lasts_s: float
    lost_s: float


def pauses_in(points: Floats, time_s: Floats) -> tuple[Pause, ...]:
    """Return the pauses between `points` (2, n) at `time_s` (n,), nondecreasing."""
    if time_s.size < 2:
        return ()
    gone, steps = np.diff(time_s), step_lengths(points)
    moving = (gone > 0.0) & (steps > 0.0)
    if not moving.any():
        return ()
    speed = float(np.median(steps[moving] / gone[moving]))
    usual = float(np.median(gone[moving]))
    lost = gone - np.maximum(steps / speed, usual)
    return tuple(
        Pause(k, float(gone[k]), float(lost[k])) for k in np.flatnonzero(lost >= PAUSE).tolist()
    )


def without_pauses(time_s: Floats, pauses: tuple[Pause, ...]) -> Floats:
    """Return the times (s) of a drive whose pauses lose no time."""
    lost = np.zeros(time_s.size)
    for pause in pauses:
        lost[pause.point + 1] = pause.lost_s
    return np.asarray(time_s - np.cumsum(lost))
