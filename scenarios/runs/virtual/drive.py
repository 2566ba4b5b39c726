"""The harness of virtual runs: simulate a scenario and pass its messages to observers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from scenarios.definition.scenario import Scenario
from scenarios.runs.node.node import VehicleFaultError
from scenarios.runs.node.sink import BusSink
from scenarios.runs.observer import Kinds, Listen, Observer, listeners_by_kind
from scenarios.runs.virtual.virtual_convoy import VirtualConvoy, never
from transport.bus.bus import Bus
from transport.topics import RUN_SENDER
from vehicles.messages import GpsPose, Message, RunStart, TruePose

if TYPE_CHECKING:  # only runs with replayed vehicles read logs
    from scenarios.runs.node.recorded_vehicle import Replay


@dataclass(frozen=True, slots=True)
class DriveOutcome:
    """End of a virtual run: last instant (ns), and the fault of a vehicle that ended it."""

    at: int
    fault: VehicleFaultError | None

    def raise_fault(self) -> None:
        if self.fault is not None:
            raise self.fault


class ObservedSink:
    """Publishes the poses of one vehicle and passes all its messages to listeners.

    Only `published` messages, which other vehicles receive, are encoded; `flush` publishes them.
    """

    def __init__(
        self,
        vehicle: str,
        bus: Bus,
        now: Callable[[], int],
        listeners: Mapping[type[Message], Sequence[Listen]],
        published: Kinds = frozenset({GpsPose}),
    ) -> None:
        on_bus = BusSink(vehicle, bus)
        self.flush = on_bus.flush
        self._publish = on_bus.send
        self._published = published
        self._now = now
        self._listeners = listeners

    def send(self, message: Message) -> None:
        kind = type(message)
        if kind in self._published:
            self._publish(message)
        for listen in self._listeners[kind]:
            listen(self._now(), message)

    def reads(self, kind: type[Message]) -> bool:
        return kind in self._published or bool(self._listeners[kind])


def drive(
    scenario: Scenario,
    observers: Sequence[Observer],
    *,
    until: Callable[[], bool] = never,
    replays: "Sequence[Replay]" = (),
    on_left: Callable[[int, str], None] = lambda _at, _vehicle: None,
) -> DriveOutcome:
    """Simulate `scenario` in virtual time, as fast as the machine goes.

    The observers receive the start of the run, the messages of all vehicles and their final
    counters. The result depends on the scenario, its seed, the replays and the versions only.

    Args:
        scenario: What to simulate.
        observers: Called in this order for each message.
        until: Ends the run early once it is true; evaluated after each step of a vehicle.
        replays: Vehicles that send what was recorded, while the others are live.
        on_left: Called with the instant (ns) and the name of a vehicle that fails while the
            others continue.

    """
    listeners = listeners_by_kind(observers)
    convoy = VirtualConvoy(scenario, on_left)
    bus, now = convoy.bus, convoy.clock.now
    start = RunStart(vehicle=RUN_SENDER, seq=0, start_at_ns=now(), run_id=scenario.virtual_run_id)
    for listen in listeners[RunStart]:
        listen(now(), start)

    def sink_of(vehicle: str) -> ObservedSink:
        measured = {TruePose} if scenario.is_measured(vehicle) else set()
        return ObservedSink(vehicle, bus, now, listeners, frozenset({GpsPose, *measured}))

    nodes = convoy.build(sink_of, replays)
    fault = None
    try:
        convoy.run(until)
    except VehicleFaultError as error:
        fault = error
    for name, node in nodes.items():
        if name not in convoy.left:  # a vehicle that left has sent its final counters
            node.outbox.publish_health(now(), final=True)
    return DriveOutcome(now(), fault)
