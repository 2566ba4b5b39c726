"""Whether receivers are good enough to follow another car's path by."""

from collections.abc import Iterator
from math import hypot
from typing import NamedTuple

from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup

DEVIATIONS = 2.0
"""So many standard deviations are looked at: one pair of receivers in twenty is further apart."""


class _Lasting(NamedTuple):
    """Errors of a receiver that last: standard deviation (m) per axis, and a given bias (m)."""

    deviation: float = 0.0
    east: float = 0.0
    north: float = 0.0

    def from_another(self, other: "_Lasting") -> float:
        """By how much (m) two receivers may differ."""
        given = hypot(self.east - other.east, self.north - other.north)
        return DEVIATIONS * hypot(self.deviation, other.deviation) + given


def receiver_warnings(scenario: Scenario) -> Iterator[str]:
    """Give a line for followers whose receivers differ by more than the lane has room beside them.

    A path is followed as far aside as the receivers of its sender and of the follower differ. Only
    what lasts counts (drift and bias): white noise is averaged by fit and filter.
    """
    setups = {name: scenario.vehicle(name) for name in scenario.vehicle_names}
    errors = {name: _lasting(setup) for name, setup in setups.items()}
    beyond: dict[str, float] = {}
    rooms: dict[str, float] = {}
    for name in scenario.vehicle_names[1:]:
        if name in scenario.replays:
            continue
        setup = setups[name]
        own = _Lasting() if setup.has_exact_state else errors[name]
        apart = max(own.from_another(errors[sender]) for sender in setup.senders)
        room = 0.5 * max(scenario.tables.events.lane_width_m - setup.parameters.width, 0.0)
        if apart > room:
            beyond[name], rooms[name] = apart, room
    if beyond:
        yield (
            f"{', '.join(beyond)}: the receivers that they steer by differ by up to "
            f"{max(beyond.values()):.1f} m (two standard deviations of drift and bias), the lane "
            f"leaves {min(rooms.values()):.1f} m beside a car: expect departures from it even on "
            "clean links, and slides where the speed is high; better receivers are "
            'gnss.preset = "rtk_fixed" and "rtk_float"'
        )


def _lasting(setup: VehicleSetup) -> _Lasting:
    bias = setup.gnss.bias
    east, north = (bias.east, bias.north) if bias else (0.0, 0.0)
    return _Lasting(setup.gnss.lasting_deviation, east, north)
