"""Accuracy of receivers compared with the room in the lane."""

from collections.abc import Iterator
from math import hypot
from typing import NamedTuple

from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup

DEVIATIONS = 2.0
"""Standard deviations taken into account: one pair of receivers in twenty differs by more."""


class _Lasting(NamedTuple):
    """Lasting errors of a receiver: standard deviation (m) per axis, and a given bias (m)."""

    deviation: float = 0.0
    east: float = 0.0
    north: float = 0.0

    def from_another(self, other: "_Lasting") -> float:
        """Largest difference (m) between two receivers."""
        given = hypot(self.east - other.east, self.north - other.north)
        return DEVIATIONS * hypot(self.deviation, other.deviation) + given


def receiver_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn if receivers differ by more than the lane leaves beside a car.

    A follower drives as far off a path as its receiver differs from the sender's. Only drift and
    bias count: fit and filter average white noise.
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
            f"{', '.join(beyond)}: receivers differ by up to {max(beyond.values()):.1f} m (two "
            f"standard deviations of drift and bias), the lane leaves {min(rooms.values()):.1f} m "
            "beside a car: cars will leave the lane even on clean links, and slide at high speed. "
            'Set gnss.preset = "rtk_fixed" or "rtk_float".'
        )


def _lasting(setup: VehicleSetup) -> _Lasting:
    bias = setup.gnss.bias
    east, north = (bias.east, bias.north) if bias else (0.0, 0.0)
    return _Lasting(setup.gnss.lasting_deviation, east, north)
