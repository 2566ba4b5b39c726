"""One vehicle as a node: the same object under the wall clock and in virtual time."""

from collections.abc import Callable
from dataclasses import dataclass

from scenarios.definition.road.lead_speed import SpeedPlan
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.runs.node.outbox import DueChange, Outbox, OutboxState, PendingChanges
from scenarios.runs.node.phases import (
    Car,
    ChangeExecutor,
    CrashedError,
    Down,
    VehicleContext,
    VehiclePhase,
)
from scenarios.runs.node.recorded_vehicle import RecordedNode, ReplayedNode
from transport.clock import Tick
from transport.links.inbox import Inbox, InboxCounts
from vehicles.car.dynamics import OutOfModelError
from vehicles.schedule import SECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftwareHandover:
    """State that outlives a crash of a vehicle's software, after the tick at `at` (ns).

    The software restarts at `until` (ns).
    """

    at: int
    until: int
    car: Car
    plan: SpeedPlan
    pending: tuple[DueChange, ...]
    changed_links: tuple[DueChange, ...]
    outbox: OutboxState
    inbox: InboxCounts


class Node:
    """A car with sensors, driver, inbox and outbox."""

    def __init__(
        self, context: VehicleContext, changes: ChangeExecutor, phase: VehiclePhase
    ) -> None:
        self._context = context
        self._changes = changes
        self.phase = phase

    def step(self, tick: Tick) -> None:
        """Carry out changes, measure, receive, decide and send; then move the car."""
        self.phase = self._changes.apply(tick.at, self.phase)
        self._context.car.advance(self.phase.step(tick.at), tick.span_s)

    @property
    def inbox(self) -> Inbox:
        return self._context.inbox

    @property
    def outbox(self) -> Outbox:
        return self._context.outbox

    @property
    def pending_changes(self) -> PendingChanges:
        return self._changes.pending_changes

    @property
    def car(self) -> Car:
        return self._context.car

    def handover(self, now: int) -> SoftwareHandover | None:
        """State for the restart if the software is down after the tick at `now` (ns), else None."""
        if not isinstance(self.phase, Down):
            return None
        return SoftwareHandover(
            at=now,
            until=self.phase.until,
            car=self._context.car,
            plan=self._context.plan,
            pending=self.pending_changes.pending,
            changed_links=self._changes.links.by_hand,
            outbox=self.outbox.state,
            inbox=self.inbox.counts,
        )


class VehicleFaultError(Exception):
    """Fault of `vehicle` in one line; `text` is the line without the vehicle's name."""

    def __init__(self, vehicle: str, text: str) -> None:
        self.vehicle, self.text = vehicle, text
        super().__init__(f"{vehicle}: {text}")


AnyNode = Node | ReplayedNode | RecordedNode


def step_with_faults(node: AnyNode, vehicle: str, start_at: int) -> Callable[[Tick], None]:
    """Return `node.step`, with faults of plug-ins or the car raised as VehicleFaultError."""

    def step(tick: Tick) -> None:
        try:
            node.step(tick)
        except (PlugInError, OutOfModelError, CrashedError) as error:
            after_s = (tick.at - start_at) / SECOND
            raise VehicleFaultError(vehicle, f"{error}, {after_s:.2f} s after the start") from error

    return step
