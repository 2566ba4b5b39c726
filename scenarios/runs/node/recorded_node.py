"""A vehicle that sends recorded messages: it measures, receives and decides nothing."""

from dataclasses import dataclass, field

from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.pending_changes import PendingChanges
from scenarios.runs.node.recorded_vehicle import Replay
from transport.clock import Tick
from transport.links.inbox import Inbox


@dataclass(slots=True, kw_only=True)
class RecordedNode:
    """Recorded messages instead of car, sensors and driver. Its inbox stays empty."""

    replay: Replay
    inbox: Inbox
    outbox: Outbox
    pending_changes: PendingChanges = field(default_factory=PendingChanges)
    _sent: int = 0

    def step(self, tick: Tick) -> None:
        due, messages = self._sent, self.replay.messages
        while due < len(messages) and self.replay.instants[due] <= tick.at:
            due += 1
        self.outbox.publish_recorded(tick.at, messages[self._sent : due])
        self._sent = due

    def handover(self, now: int) -> None:
        """No software, no handover."""
