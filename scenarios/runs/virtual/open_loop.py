"""A vehicle in open loop: its software decides on recorded inputs, and its car obeys the record.

The messages that the vehicle received come from a log, in the order in which it received them. Its
links judge them again, and its sensors measure again: their random numbers depend on the seed only.
The car moves by the recorded commands, so its motion is the recorded one, whatever the software
decides.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.plug_ins.guards import PlugInError
from scenarios.runs.node.assembly.vehicle_builder import VehicleBuilder
from scenarios.runs.node.change_executor import CrashedError
from scenarios.runs.node.node import Node
from scenarios.runs.node.phases import Driving
from scenarios.runs.node.probe import NoProbe
from transport.codec import decode
from transport.log.reader import LogReader
from transport.log.records import LogError
from transport.topics import RUN_SENDER, key, valid_at
from vehicles.car.dynamics import Actuation, OutOfModelError
from vehicles.messages import Command, LinkVerdict, Message, RunStart, Tracking, TruePose
from vehicles.schedule import SECOND


@dataclass(slots=True)
class Decisions:
    """Messages of one vehicle by the instant (ns) of a decision, and its verdicts by message."""

    commands: dict[int, Command] = field(default_factory=dict)
    tracking: dict[int, Tracking] = field(default_factory=dict)
    truth: dict[int, TruePose] = field(default_factory=dict)
    verdicts: dict[tuple[str, int], LinkVerdict] = field(default_factory=dict)

    def send(self, message: Message) -> None:
        match message:
            case Command():
                self.commands[message.decided_at_ns] = message
            case Tracking():
                self.tracking[message.decided_at_ns] = message
            case TruePose():
                self.truth[message.true_at_ns] = message
            case LinkVerdict():
                self.verdicts[message.sender, message.pose_seq] = message

    def flush(self) -> None:
        """Nothing waits."""

    def reads(self, kind: type[Message]) -> bool:
        return kind in {Command, Tracking, TruePose, LinkVerdict}


@dataclass(frozen=True, slots=True)
class RecordedInputs:
    """What a vehicle received and decided in a run from `start_at` (ns).

    `arrivals` are the messages with a verdict, as the instant from which they are available, their
    key and their bytes, in that order. With a gap sensor they include the true poses that it
    measured.
    """

    start_at: int
    arrivals: Sequence[tuple[int, str, bytes]]
    decisions: Decisions


def read_inputs(
    reader: LogReader, vehicle: str, senders: Sequence[str], measured: str = ""
) -> RecordedInputs:
    """Read the inputs of a vehicle; raises LogError if the log lacks topics or the vehicle.

    `measured` is the vehicle whose true poses its gap sensor measures, if it has one.
    """
    reader.require_all("verdict", "command", *(["truth"] if measured else []))
    if not reader.counts.get((vehicle, "command")):
        known = sorted({name for name, topic in reader.counts if topic == "command"})
        raise LogError(
            f"{reader.path}: holds no commands of {vehicle!r}, but of {', '.join(known) or 'none'}"
        )
    decisions, start_at = Decisions(), 0
    own = ("start", "verdict", "command", "tracking", "truth")
    for _, _, message in reader.messages(own, (vehicle, RUN_SENDER)):
        if isinstance(message, RunStart):
            start_at = message.start_at_ns
        elif not isinstance(message, LinkVerdict) or message.sender in senders:
            decisions.send(message)
    arrivals: list[tuple[int, str, int, bytes]] = []
    for _, sender, topic, data in reader.encoded_messages(("gps",), senders):
        number = decode(topic, data).seq
        verdict = decisions.verdicts.get((sender, number))
        if verdict is not None:
            # A late message was first available at the tick that judged it.
            at = verdict.received_at_ns if verdict.late else verdict.sent_at_ns
            arrivals.append((at, key(sender, topic), number, data))
    if measured:
        for _, _, topic, data in reader.encoded_messages(("truth",), (measured,)):
            truth = decode(topic, data)
            arrivals.append((valid_at(truth), key(measured, topic), truth.seq, data))
    arrivals.sort()
    inputs = [(at, sender_key, data) for at, sender_key, _, data in arrivals]
    return RecordedInputs(start_at, inputs, decisions)


def decide_again(scenario: Scenario, vehicle: str, inputs: RecordedInputs) -> Decisions:
    """Let the software of `vehicle` in `scenario` decide on `inputs`.

    Raises LogError if its controller or its car fails.
    """
    builder, sink, start_at = VehicleBuilder(scenario, vehicle), Decisions(), inputs.start_at
    node = builder.node(start_at, sink, NoProbe())
    if not isinstance(node, Node):
        raise LogError(f"{vehicle} is replayed and decides nothing")
    arrivals, recorded = deque(inputs.arrivals), inputs.decisions.commands
    last_at = max(recorded)
    command = Actuation(0.0, 0.0)
    for tick in builder.ticks(start_at):
        if tick.at > last_at:  # an interrupted run
            break
        while arrivals and arrivals[0][0] <= tick.at:
            _, sender_key, data = arrivals.popleft()
            if builder.target is not None and sender_key == builder.target.key:
                builder.target.on_bytes(sender_key, data)
            else:
                node.inbox.on_bytes(sender_key, data)
        try:
            decided = node.decide(tick.at)
            if (given := recorded.get(tick.at)) is not None:
                command = Actuation(given.steering_rad, given.acceleration_mps2)
            drives = isinstance(node.phase, Driving)
            node.car.advance(command if drives else decided, tick.span_s)
        except CrashedError:
            break
        except (PlugInError, OutOfModelError) as error:
            after_s = (tick.at - start_at) / SECOND
            raise LogError(f"{vehicle}: {error}, {after_s:.2f} s after the start") from error
    return sink
