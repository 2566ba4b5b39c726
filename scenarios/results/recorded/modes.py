"""Changes of the mode of a vehicle."""

from typing import NamedTuple

import numpy as np

from scenarios.results.recorded.run_record import VehicleRecord
from transport.log.errors import LogError


class ModeFrom(NamedTuple):
    """The mode of a vehicle from `at_s` (s after the start) on."""

    at_s: float
    mode: str


def mode_changes(vehicle: VehicleRecord) -> tuple[ModeFrom, ...]:
    """List the modes of a vehicle, the first one included; none without a record of them."""
    try:
        modes, at_s = vehicle.tracking["mode"], vehicle.tracking["t_s"]
    except LogError:  # the topic was not recorded
        return ()
    if not len(modes):
        return ()
    changed = np.flatnonzero(modes[1:] != modes[:-1]) + 1
    return tuple(ModeFrom(float(at_s[row]), str(modes[row])) for row in [0, *changed.tolist()])
