"""One vehicle as a node: the same object under the wall clock and in virtual time."""

from dataclasses import dataclass

from scenarios.definition.road.set_speed import SpeedPlan
from scenarios.runs.node.agenda import Agenda, Due
from scenarios.runs.node.changes import Changes
from scenarios.runs.node.outbox import Outbox, OutboxState
from scenarios.runs.node.phases import Car, Down, VehicleContext, VehiclePhase
from transport.clock import Tick
from transport.links.inbox import Inbox, InboxCounts


@dataclass(frozen=True, slots=True, kw_only=True)
class Handover:
    """State that outlives a crash of a vehicle's software, after the tick at `at` (ns).

    The software restarts at `until` (ns).
    """

    at: int
    until: int
    car: Car
    plan: SpeedPlan
    pending: tuple[Due, ...]
    changed_links: tuple[Due, ...]
    outbox: OutboxState
    inbox: InboxCounts


class Node:
    """A car with sensors, driver, inbox and outbox."""

    def __init__(self, context: VehicleContext, changes: Changes, phase: VehiclePhase) -> None:
        self._context = context
        self._changes = changes
        self.phase = phase

    def step(self, tick: Tick) -> None:
        self.phase = self._changes.by(tick.at, self.phase)
        command = self.phase.step(tick.at)
        self._context.car.advance(command, tick.span_s)

    @property
    def inbox(self) -> Inbox:
        return self._context.inbox

    @property
    def outbox(self) -> Outbox:
        return self._context.outbox

    @property
    def agenda(self) -> Agenda:
        return self._changes.agenda

    @property
    def car(self) -> Car:
        return self._context.car

    def handover(self, now: int) -> Handover | None:
        """State for the restart if the software is down after the tick at `now` (ns), else None."""
        if not isinstance(self.phase, Down):
            return None
        return Handover(
            at=now,
            until=self.phase.until,
            car=self._context.car,
            plan=self._context.plan,
            pending=self.agenda.pending,
            changed_links=self._changes.links.by_hand,
            outbox=self.outbox.state,
            inbox=self.inbox.counts,
        )
