"""`convoy vehicle`: one vehicle as a process of its own, over Zenoh, on the wall clock."""

from collections.abc import Iterable, Iterator

import click

from scenarios.definition.scenario import Scenario
from scenarios.runs.node.assembly import VehicleBuilder
from scenarios.runs.node.fault import VehicleFaultError, stepping
from scenarios.runs.node.probe import ProcessProbe
from scenarios.runs.node.sink import BusSink
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.bus.bus import Bus
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.clock import Tick, WallClock, late_after, poll
from transport.codec import RefusedMessageError, decode
from transport.topics import CONDUCTOR, TOPICS, key
from vehicles.messages import RunEnd, RunStart

POLL_S = 0.01
END_S = 8.0
"""How long a vehicle that has finished waits until the recorder's log is complete."""


def run_vehicle(scenario: Scenario, name: str, options: ZenohOptions, stop: Stop) -> int:
    """Drive vehicle `name` of `scenario` for one run; returns the exit code."""
    builder = VehicleBuilder(scenario, name)
    with open_bus(options) as bus:
        stop.begun = True
        try:
            finished = drive(builder, bus, stop)
        except VehicleFaultError as fault:
            if not stop.launched:  # else the recorder says it
                click.echo(fault, err=True)
            return EXIT_FAILED
    return 0 if finished else stop.exit_code


class RunAnnouncements:
    """What the recorder announced: when the run starts, and that it is over.

    The bytes of some other messages can be decoded as a start or an end too. They are recognised
    by the vehicle that they name; a start that came under the end's key, by its instant.
    """

    def __init__(self, bus: Bus) -> None:
        self.start: RunStart | None = None
        self.end: RunEnd | None = None
        for name in ("start", "end"):
            bus.subscribe(key(CONDUCTOR, TOPICS[name]), self._receive)

    def _receive(self, key_expression: str, data: bytes) -> None:
        try:
            message = decode(TOPICS[key_expression.rsplit("/", 1)[-1]], data, exact=True)
        except RefusedMessageError:
            return
        if message.vehicle != CONDUCTOR:
            return
        if isinstance(message, RunStart):
            self.start = self.start or message
        elif isinstance(message, RunEnd) and self._is_of_this_run(message):
            self.end = message

    def _is_of_this_run(self, end: RunEnd) -> bool:
        return self.start is not None and end.end_at_ns != self.start.start_at_ns


def drive(builder: VehicleBuilder, bus: Bus, stop: Stop) -> bool:
    """Announce the vehicle, wait for the start, drive, send the final counters.

    Returns whether it drove until the run was over, rather than until it was asked to stop. Raises
    VehicleFaultError if its controller fails; by then everybody knows.
    """
    announced = RunAnnouncements(bus)
    bus.announce(builder.name)
    poll(lambda: announced.start is not None or stop.asked, every_s=POLL_S)
    if announced.start is None:
        return False
    start_at = announced.start.start_at_ns
    end_at = start_at + builder.duration_ns
    clock = WallClock(stop.event)
    probe = ProcessProbe(late_after(builder.control_rate_hz))
    node = builder.node(start_at, BusSink(builder.name, bus), probe)
    for sender_key in node.inbox.keys:
        bus.subscribe(sender_key, node.inbox.on_bytes)
    step = stepping(node, builder.name, start_at)
    try:
        for tick in punctual(builder.ticks(start_at), clock, probe):
            if stop.asked or announced.end is not None:
                break
            step(tick)
    except VehicleFaultError as fault:
        node.outbox.publish_fault(clock.now(), fault.text)
        poll(lambda: announced.end is not None or stop.asked, every_s=POLL_S, at_most_s=END_S)
        raise
    clock.wait_until(0 if announced.end is not None else end_at)
    finished = not stop.asked
    node.outbox.publish_health(min(clock.now(), end_at), final=True)
    poll(lambda: announced.end is not None or stop.asked, every_s=POLL_S, at_most_s=END_S)
    return finished


def punctual(ticks: Iterable[Tick], clock: WallClock, probe: ProcessProbe) -> Iterator[Tick]:
    """Yield each tick at its instant; after a delay the missed ones follow one by one, at once."""
    for tick in ticks:
        probe.tick_began(clock.wait_until(tick.at))
        yield tick
