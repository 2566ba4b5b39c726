"""Longitudinal controllers as plug-ins."""

from scenarios.definition.schema.plug_ins.guards import called, finite
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from vehicles.driver.longitudinal.controller import (
    LongitudinalController,
    LongitudinalSetup,
    OwnMotion,
    SourceMotion,
    VehiclesAhead,
)


class GuardedFollowing:
    """Wraps a user's longitudinal controller, and converts its faults to PlugInError."""

    def __init__(self, controller: LongitudinalController, name: str) -> None:
        self._controller = controller
        self._what = f"controller {name!r}: acceleration()"

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        value = called(lambda: self._controller.acceleration(speed, ahead), self._what)
        return finite(value, f"{self._what} returned", "acceleration (m/s²)")


def try_following(controller: LongitudinalController, setup: LongitudinalSetup) -> list[float]:
    """Call `acceleration` at 20 m/s, 1 m too far behind sources of that speed, and at 18 m/s."""
    accelerations = []
    for speed in (20.0, 18.0):
        ahead = VehiclesAhead(
            own=OwnMotion(setup.period, 0.0, 100.0),
            sources={
                name: SourceMotion(policy.desired(speed) + 1.0, 20.0, 0.0, 0.1)
                for name, policy in setup.policies.items()
            },
        )
        if setup.predecessor in setup.policies:
            ahead.spacing, ahead.predecessor_speed = setup.policy.desired(speed) + 1.0, 20.0
        if setup.lead in setup.policies:
            ahead.lead_speed, ahead.lead_acceleration = 20.0, 0.0
        accelerations.append(controller.acceleration(speed, ahead))
    return accelerations


LONGITUDINAL = PlugInPoint(
    name="controller",
    title="longitudinal controller",
    key="control.longitudinal",
    shipped={
        name: f"vehicles.driver.longitudinal.laws.{law}"
        for name, law in (
            ("gap", "GapLaw"),
            ("acc", "Acc"),
            ("cacc", "Cacc"),
            ("ploeg", "Ploeg"),
            ("flatbed", "Flatbed"),
            ("consensus", "Consensus"),
        )
    },
    contract=LongitudinalController,
    methods={"acceleration": "speed, ahead"},
    types=(LongitudinalSetup, VehiclesAhead, OwnMotion, SourceMotion),
    arguments="setup",
    draws=True,
    guard=GuardedFollowing,
    trial=try_following,
)
