"""A recorded vehicle on the bus: its poses from the log of a run, shifted in time.

Live followers receive its messages over the same links as from a live vehicle. Its recorded true
states are sent too, for the new log and its figures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import atan
from operator import attrgetter
from pathlib import Path

from scenarios.definition.recorded_messages import digest_of
from scenarios.definition.road.replayed_drive import ReplayedDrive
from scenarios.definition.schema.scenario_tables import ReplayTable
from scenarios.runs.node.outbox import Outbox, PendingChanges
from scenarios.runs.node.phases import change_receiver
from transport.clock import Tick
from transport.links.inbox import Inbox
from transport.log.errors import LogError
from transport.topics import RUN_SENDER
from vehicles.car.dynamics import Body
from vehicles.car.gnss import GnssReceiver
from vehicles.car.sending_rules import Sender
from vehicles.messages import GpsPose, RunStart, TruePose
from vehicles.schedule import SECOND, Cadence


@dataclass(frozen=True, slots=True)
class RecordedVehicle:
    """Poses and true states of one vehicle in a log, and the start of its run (ns)."""

    started_at: int
    poses: tuple[GpsPose, ...]
    truth: tuple[TruePose, ...]

    def instants(self, start_at: int) -> list[int]:
        """Instants (ns) of sending in a run that starts at `start_at` (ns)."""
        shift = start_at - self.started_at
        sent = [*map(_acts_at, self.poses), *map(_acts_at, self.truth)]
        return sorted(at + shift for at in sent)

    def messages(self, start_at: int) -> list[GpsPose | TruePose]:
        """Messages in order of time, shifted to a run that starts at `start_at` (ns).

        Poses are numbered from 0; holes in the true poses remain.
        """
        shift = start_at - self.started_at
        messages: list[GpsPose | TruePose] = [
            replace(
                p,
                seq=seq,
                measured_at_ns=p.measured_at_ns + shift,
                sent_at_ns=p.sent_at_ns + shift,
                stops_at_ns=p.stops_at_ns + shift if p.stops_at_ns else 0,
                relayed_stops_at_ns=tuple(at + shift if at else 0 for at in p.relayed_stops_at_ns),
            )
            for seq, p in enumerate(self.poses)
        ]
        first = self.truth[0].seq if self.truth else 0
        messages += [
            replace(t, seq=t.seq - first, true_at_ns=t.true_at_ns + shift) for t in self.truth
        ]
        return sorted(messages, key=_acts_at)


def _acts_at(message: GpsPose | TruePose) -> int:
    """Instant (ns) of sending, which for a pose may follow that of its measurement."""
    return message.sent_at_ns if isinstance(message, GpsPose) else message.true_at_ns


def read_replayed_vehicle(table: ReplayTable | None, vehicle: str) -> RecordedVehicle | None:
    """Read the messages of `vehicle` in the log of `[replay]`; None if it is not replayed.

    Raises LogError if the log is not the one that the scenario was read with.
    """
    if table is None or vehicle not in table.vehicles:
        return None
    log = Path(table.log)
    if table.digest not in {"", digest_of(log)}:
        raise LogError(f"{log}: is another log than when the scenario was read")
    return read_recorded_vehicle(log, vehicle, partial=table.partial)


def read_recorded_vehicle(log: Path, vehicle: str, *, partial: bool = False) -> RecordedVehicle:
    """Read the messages of `vehicle` in `log`.

    Raises LogError if there are none, or unless `partial` if the log is damaged or lacks some.
    """
    from transport.log.reader import LogReader  # noqa: PLC0415 - not in a usual vehicle's process

    reader = LogReader(log)
    reader.require_all("truth")
    if not partial:
        reader.refuse_faults("gps", "truth")
    poses: list[GpsPose] = []
    truth: list[TruePose] = []
    started_at: int | None = None
    for _, _, message in reader.messages(("gps", "truth", "start"), (vehicle, RUN_SENDER)):
        if isinstance(message, RunStart):
            started_at = message.start_at_ns
        elif isinstance(message, GpsPose):
            poses.append(message)
        elif isinstance(message, TruePose):
            truth.append(message)
    poses.sort(key=attrgetter("seq"))  # on a network messages overtake each other
    truth.sort(key=attrgetter("seq"))
    if not poses:
        known = ", ".join(sorted({name for name, topic in reader.counts if topic == "gps"}))
        raise LogError(f"{log}: holds no poses of {vehicle!r}, but of {known or 'no vehicle'}")
    start = poses[0].measured_at_ns if started_at is None else started_at
    return RecordedVehicle(start, tuple(poses), tuple(truth))


# ---- A vehicle that sends recorded messages: it measures, receives and decides nothing


@dataclass(slots=True, kw_only=True)
class RecordedNode:
    """Recorded messages instead of car, sensors and driver. Its inbox stays empty."""

    messages: Sequence[GpsPose | TruePose]
    inbox: Inbox
    outbox: Outbox
    pending_changes: PendingChanges = field(default_factory=PendingChanges)
    _sent: int = 0

    def step(self, tick: Tick) -> None:
        due, messages = self._sent, self.messages
        while due < len(messages) and _acts_at(messages[due]) <= tick.at:
            due += 1
        self.outbox.publish_recorded(tick.at, messages[self._sent : due])
        self._sent = due

    def handover(self, now: int) -> None:
        """No software, no handover."""


# ---- A vehicle that repeats a recorded drive: it measures and sends, without a driver


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
        self.outbox.publish_idle(tick.at, body, None, fix, self.sender.path, fresh=fresh)

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
