"""One vehicle as a node: the same object under the wall clock and in virtual time."""

from dataclasses import dataclass

from scenarios.definition.changing.asked import in_words
from scenarios.runs.node.agenda import Agenda
from scenarios.runs.node.changed_links import ChangedLinks
from scenarios.runs.node.outbox import Outbox
from transport.clock import Tick
from transport.links.inbox import Inbox
from transport.links.laws.effect import Whereabouts
from vehicles.car.dynamics import Body, advance
from vehicles.car.gnss import GnssReceiver
from vehicles.car.imu import ExactSensor, InertialSensor
from vehicles.car.parameters import VehicleParameters
from vehicles.car.sending import Sender
from vehicles.driver.decision import Driver


@dataclass(slots=True, kw_only=True)
class Node:
    """A car, its sensors and its driver, with its incoming and its outgoing messages."""

    body: Body
    parameters: VehicleParameters
    gnss: GnssReceiver
    imu: InertialSensor | ExactSensor
    driver: Driver
    sender: Sender
    inbox: Inbox
    outbox: Outbox
    agenda: Agenda
    links: ChangedLinks

    def step(self, tick: Tick) -> None:
        """One tick of the schedule: receive, measure, decide, send, advance the car to the next."""
        for due in self.agenda.take(tick.at):
            text = self.links.carry_out(due) or in_words(due.change)
            self.outbox.publish_change(tick.at, due, text)
        body = self.body
        here = Whereabouts(body.east, body.north, body.distance)
        received = self.inbox.take(tick.at, here)
        fix = self.gnss.measure(self.body, tick.at)
        motion = self.imu.measure(self.body, tick.at)
        decision = self.driver.step(tick.at, fix, motion, received)
        self.outbox.publish(tick.at, self.body, self.sender.send(tick.at, fix), decision)
        self.body = advance(self.body, decision.actuation, tick.span_s, self.parameters)
