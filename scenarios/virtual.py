"""`--clock virtual`: the same nodes in one process over a memory bus, as fast as they go."""

from collections.abc import Iterator, Sequence
from heapq import merge
from pathlib import Path
from typing import Any

from scenarios.assembly import Kit
from scenarios.leash import Stop
from scenarios.node import Node
from scenarios.probe import NoProbe
from scenarios.recorder import Listener
from scenarios.run_log import RunLog
from scenarios.scenario import Scenario
from transport.clock import Tick, VirtualClock
from transport.memory_bus import MemoryBus
from transport.topics import Topic
from vehicles.messages import Message
from vehicles.schedule import SECOND


def run_virtual(
    scenario: Scenario, folder: Path, stop: Stop, *, listeners: Sequence[Listener] = ()
) -> dict[str, Any]:
    """Run `scenario` in virtual time into `folder`; returns the summary.

    Depends on nothing but the scenario, its seed and the versions: the log is equal byte for byte.
    """
    start_at = scenario.start_at_ns
    end_at = start_at + round(scenario.duration_s * SECOND)
    clock = VirtualClock(start_at)
    bus = MemoryBus()
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=f"{scenario.name}-{scenario.seed}",
        listeners=listeners,
    )

    def witness(topic: Topic, data: bytes, message: Message) -> None:
        run.recorder.witness(topic, data, message, clock.now())

    run.start(start_at, start_at)
    kits = [Kit(scenario, name) for name in scenario.vehicle_names]
    nodes = [kit.node(start_at, bus, NoProbe(), witness) for kit in kits]
    for node in nodes:
        for sender_key in node.inbox.keys:
            bus.subscribe(sender_key, node.inbox.on_bytes)
    for tick, node in _in_turn(kits, nodes, start_at):
        clock.wait_until(tick.at)
        node.step(tick)
        if stop.asked:
            break
    else:
        clock.wait_until(end_at)
    for node in nodes:
        node.outbox.publish_health(clock.now(), final=True)
    run.end(clock.now(), stop.reason)
    return run.close(clock.now())


def _in_turn(
    kits: Sequence[Kit], nodes: Sequence[Node], start_at: int
) -> Iterator[tuple[Tick, Node]]:
    """All ticks of all nodes in order of time, at one instant from the lead backwards."""
    if len({kit.rates_hz for kit in kits}) == 1:  # as usual; the rest would do, but slowly
        for tick in kits[0].ticks(start_at):
            for node in nodes:
                yield tick, node
        return

    def of_one(place: int) -> Iterator[tuple[int, int, Tick]]:
        return ((tick.at, place, tick) for tick in kits[place].ticks(start_at))

    for _, place, tick in merge(*(of_one(place) for place in range(len(kits)))):
        yield tick, nodes[place]
