"""Accuracy of receivers compared with the room in the lane."""

from collections.abc import Iterator
from math import hypot
from typing import NamedTuple

from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup

DEVIATIONS = 2.0
"""Standard deviations taken into account: one pair of receivers in twenty differs by more."""

NOTICED = 0.3
"""Difference of receivers (m) from which a follower notably leaves the lead's path."""


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
    """Warn of receivers that differ by more than the lane leaves beside a car, or by `NOTICED`.

    A follower drives as far off a path as its receiver differs from the sender's. No measurement
    shows that: both know absolute positions only, and the shape of a path is the same at its side.
    Only drift and bias count: fit and filter average white noise.
    """
    apart, rooms = dict[str, float](), dict[str, float]()
    setups = {name: scenario.vehicle(name) for name in scenario.vehicle_names}
    errors = {name: _lasting(setup) for name, setup in setups.items()}
    for name in scenario.vehicle_names[1:]:
        if name in scenario.tables.replayed:
            continue
        setup = setups[name]
        own = _Lasting() if setup.has_exact_state else errors[name]
        apart[name] = max(own.from_another(errors[sender]) for sender in setup.flow.lateral)
        rooms[name] = 0.5 * max(scenario.tables.events.lane_width_m - setup.parameters.width, 0.0)
    beyond = [name for name in apart if apart[name] > rooms[name]]
    if beyond:
        yield (
            f"{', '.join(beyond)}: receivers differ by up to {max(apart.values()):.1f} m (two "
            "standard deviations of drift and bias), the lane leaves "
            f"{min(rooms[name] for name in beyond):.1f} m beside a car: cars will leave the lane "
            'even on clean links, and slide at high speed. Set gnss.preset = "rtk_fixed" or '
            '"rtk_float".'
        )
    noticed = [name for name in apart if NOTICED < apart[name] <= rooms[name]]
    if noticed:
        yield (
            f"{', '.join(noticed)}: followers will drive up to "
            f"{max(apart[name] for name in noticed):.1f} m off the lead's path even on clean "
            "links, as their receivers have drift and bias of their own (two standard deviations), "
            'and nothing measures a position relative to the lead. Set gnss.preset = "rtk_fixed", '
            "or gnss.common_drift for an error that all receivers share."
        )


def _lasting(setup: VehicleSetup) -> _Lasting:
    bias = setup.gnss.bias
    east, north = (bias.east, bias.north) if bias else (0.0, 0.0)
    return _Lasting(setup.gnss.lasting_deviation, east, north)
