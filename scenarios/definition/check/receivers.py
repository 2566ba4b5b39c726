"""Whether receivers are good enough to follow another car's path by."""

from collections.abc import Iterator
from math import hypot

from scenarios.definition.receivers import WITH_A_FIX, error_model, states_of
from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup

DEVIATIONS = 2.0
"""So many standard deviations are looked at: one pair of receivers in twenty is further apart."""


def receiver_warnings(scenario: Scenario) -> Iterator[str]:
    """Give a line for followers whose receivers differ by more than the lane has room beside them.

    A path is followed as far aside as the receivers of its sender and of the follower differ. Only
    what lasts counts (drift and bias): white noise is averaged by fit and filter.
    """
    apart = {
        name: DEVIATIONS * _difference(scenario, name)
        for name in scenario.vehicle_names[1:]
        if name not in scenario.replays
    }
    rooms = {name: _room(scenario, name) for name in apart}
    beyond = [name for name, aside in apart.items() if aside > rooms[name]]
    if beyond:
        yield (
            f"{', '.join(beyond)}: the receivers that they steer by differ by up to "
            f"{max(apart[name] for name in beyond):.1f} m (two standard deviations of drift and "
            f"bias), the lane leaves {min(rooms[name] for name in beyond):.1f} m beside a car: "
            "expect departures from it even on clean links, and slides where the speed is high; "
            'gnss.preset = "rtk_fixed" and "rtk_float" are receivers that suffice'
        )


def _difference(scenario: Scenario, name: str) -> float:
    """Standard deviation (m) per axis between a follower's receiver and the worst of its senders'.

    One that knows its own state exactly is off by what its senders are.
    """
    setup = scenario.vehicle(name)
    own = 0.0 if setup.knows_itself else lasting_deviation(setup)
    return hypot(own, max(lasting_deviation(scenario.vehicle(one)) for one in setup.senders))


def _room(scenario: Scenario, name: str) -> float:
    """Room (m) between the side of a car in the middle of its lane and the edge of that."""
    width = scenario.vehicle(name).parameters.width
    return 0.5 * max(scenario.tables.events.lane_width_m - width, 0.0)


def lasting_deviation(setup: VehicleSetup) -> float:
    """Standard deviation (m) per axis of the errors of a receiver that last, in its worst state.

    Without what all have in common. A bias that is given, `bias.east_m` and `bias.north_m`, counts
    in full where `DEVIATIONS` of them are looked at.
    """
    model = error_model(setup.gnss)
    given = hypot(model.bias.east, model.bias.north) / DEVIATIONS
    states = states_of(setup.gnss)
    drifts = [model.states[one].drift.deviation for one in WITH_A_FIX if one in states]
    return hypot(max(drifts, default=0.0), model.bias.deviation, given)
