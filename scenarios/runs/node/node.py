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
    """All that outlives a crash of a vehicle's software, after the tick at `at` (ns).

    The car with its sensors, the plan of the convoy's speed, what is still to be done to the
    vehicle, what was done to its links by hand, and the numbers of its messages; the software
    starts anew at `until` (ns).
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
    """A car, its sensors and its driver, with its incoming and its outgoing messages."""

    def __init__(self, context: VehicleContext, changes: Changes, phase: VehiclePhase) -> None:
        self._context = context
        self._changes = changes
        self.phase = phase

    def step(self, tick: Tick) -> None:
        """One tick of the schedule: do what the phase asks for, advance the car to the next."""
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
        """All that outlives a crash, if its software is down after the tick at `now` (ns)."""
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
