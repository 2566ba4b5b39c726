"""Lateral controllers as plug-ins."""

from scenarios.definition.schema.plug_ins.guards import PlugInError, called, finite
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import TrackingErrors


class GuardedSteering:
    """Wraps a user's controller (Section III-C), and converts its faults to PlugInError."""

    def __init__(self, controller: LateralController, name: str) -> None:
        self._controller = controller
        self._what = f"controller {name!r}: steer()"

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        command = called(lambda: self._controller.steer(errors, speed), self._what)
        return steering_command(command, self._what)


def steering_command(command: object, what: str) -> SteeringCommand:
    """Return a finite command; raises PlugInError, beginning with `what`."""
    if not isinstance(command, SteeringCommand):
        given = type(command).__name__
        raise PlugInError(f"{what} returned {given}, expected a SteeringCommand")
    parts = [
        finite(getattr(command, part), f"{what} returned {part}", "number of radians")
        for part in ("steering", "feedforward", "feedback")
    ]
    return SteeringCommand(*parts)


def try_steering(controller: LateralController) -> list[SteeringCommand]:
    """Call `steer` at 10 m/s, on a straight without errors and 0.1 m to the left."""
    return [
        controller.steer(TrackingErrors(lateral, heading=0.0, yaw_rate=0.0, curvature=0.0), 10.0)
        for lateral in (0.0, 0.1)
    ]


LATERAL = PlugInPoint(
    name="controller",
    title="lateral controller",
    key="control.controller",
    shipped={
        "slip_compensated": "vehicles.driver.steering.SlipCompensated",
        "feedforward_feedback": "vehicles.driver.steering.FeedforwardFeedback",
        "stanley": "vehicles.driver.steering.Stanley",
        "pure_pursuit": "vehicles.driver.steering.PurePursuit",
    },
    contract=LateralController,
    methods={"steer": "errors, speed"},
    types=(TrackingErrors, SteeringCommand, VehicleParameters, Gains),
    arguments="parameters, gains",
    draws=True,
    guard=GuardedSteering,
    trial=try_steering,
)
