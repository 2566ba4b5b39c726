"""A vehicle that cannot drive on, by its controller, as a car, or as asked: who, when and why."""

from collections.abc import Callable

from scenarios.runs.node.changes import CrashedError
from scenarios.runs.node.node import Node
from scenarios.runs.node.replayed import ReplayedNode
from transport.clock import Tick
from vehicles.car.dynamics import OutOfModelError
from vehicles.driver.steering import ControllerError
from vehicles.schedule import SECOND


class VehicleFaultError(Exception):
    """Fault of `vehicle` in one line; `text` is the line without the vehicle's name."""

    def __init__(self, vehicle: str, text: str) -> None:
        self.vehicle, self.text = vehicle, text
        super().__init__(f"{vehicle}: {text}")


def stepping(node: Node | ReplayedNode, vehicle: str, start_at: int) -> Callable[[Tick], None]:
    """Return `node.step`, with faults of controller or car raised as VehicleFaultError."""

    def step(tick: Tick) -> None:
        try:
            node.step(tick)
        except (ControllerError, OutOfModelError, CrashedError) as error:
            after_s = (tick.at - start_at) / SECOND
            raise VehicleFaultError(vehicle, f"{error}, {after_s:.2f} s after the start") from error

    return step
