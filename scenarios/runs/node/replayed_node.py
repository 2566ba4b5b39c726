"""A vehicle that repeats a recorded drive: it measures and sends, without a driver."""

from dataclasses import dataclass
from math import atan

from scenarios.definition.road.replayed_drive import ReplayedDrive
from scenarios.runs.node.change_executor import change_receiver
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.pending_changes import PendingChanges
from transport.clock import Tick
from transport.links.inbox import Inbox
from vehicles.car.dynamics import Body
from vehicles.car.gnss import GnssReceiver
from vehicles.car.sending.sender import Sender
from vehicles.schedule import SECOND, Cadence


@dataclass(slots=True, kw_only=True)
class ReplayedNode:
    """A recorded drive instead of car and driver, with a vehicle's receiver.

    Its inbox stays empty. Only changes of its receiver have an effect.
    """

    drive: ReplayedDrive
    start_at: int
    wheelbase: float
    control: Cadence
    gnss: GnssReceiver
    sender: Sender
    inbox: Inbox
    outbox: Outbox
    pending_changes: PendingChanges

    def step(self, tick: Tick) -> None:
        change_receiver(self.pending_changes, self.gnss, self.outbox, tick.at)
        body = self._body(tick.at)
        fix = self.sender.send(tick.at, self.gnss.measure(body, tick.at))
        fresh = self.control.due(tick.at)
        self.outbox.publish_replayed(tick.at, body, fix, self.sender.path, fresh=fresh)

    def handover(self, now: int) -> None:
        """No software, no handover."""

    def _body(self, now: int) -> Body:
        """The car at `now` (ns), along its path without slip."""
        place, speed, distance = self.drive.at((now - self.start_at) / SECOND)
        return Body(
            east=place.east,
            north=place.north,
            yaw=place.yaw,
            speed=speed,
            yaw_rate=speed * place.curvature,
            steering=atan(self.wheelbase * place.curvature),
            distance=distance,
        )
