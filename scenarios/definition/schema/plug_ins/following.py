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
    """Call `acceleration` at 20 m/s, 1 m too far behind vehicles of that speed, and at 18 m/s."""
    accelerations = []
    for speed in (20.0, 18.0):
        spacing = setup.policy.desired(speed) + 1.0
        source = SourceMotion(spacing, speed, 0.0, 0.1)
        ahead = VehiclesAhead(
            spacing=spacing,
            predecessor_speed=20.0,
            lead_speed=20.0,
            lead_acceleration=0.0,
            own=OwnMotion(setup.period, 0.0, 100.0),
            sources=dict.fromkeys((setup.lead, setup.predecessor), source),
        )
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
