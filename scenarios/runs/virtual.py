"""`--clock virtual`: the same nodes in one process over a memory bus, as fast as they go."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.actors import Actor, in_turn
from scenarios.runs.node.assembly import Kit
from scenarios.runs.node.node import Node
from scenarios.runs.node.outbox import Witness, nobody
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.recorder import Listener
from scenarios.runs.replay import Replay
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import Stop
from transport.bus.memory_bus import MemoryBus
from transport.clock import VirtualClock
from transport.topics import Topic
from vehicles.messages import Message
from vehicles.schedule import SECOND


def run_virtual(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    *,
    listeners: Sequence[Listener] = (),
    replays: Sequence[Replay] = (),
) -> RunSummary:
    """Run `scenario` in virtual time into `folder`; returns the summary.

    Vehicles in `replays` say what was recorded, the others are live. Depends on nothing but these,
    the scenario, its seed and the versions: the log is equal byte for byte.
    """
    world = World(scenario)
    clock = world.clock
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=f"{scenario.name}-{scenario.seed}",
        listeners=listeners,
    )

    def witness(topic: Topic, data: bytes, message: Message) -> None:
        run.recorder.on_sent(topic, data, message, clock.now())

    run.start(clock.now(), clock.now())
    nodes = world.populate(replays, witness)
    world.go(stop)
    for node in nodes.values():
        node.outbox.publish_health(clock.now(), final=True)
    run.end(clock.now(), stop.reason)
    return run.close(clock.now())


class World:
    """The vehicles of a scenario in one process: their bus, their time, their turns."""

    def __init__(self, scenario: Scenario) -> None:
        self.bus = MemoryBus()
        self.clock = VirtualClock(scenario.start_at_ns)
        self._scenario = scenario
        self._actors: list[Actor] = []

    def populate(
        self, replays: Sequence[Replay] = (), witness: Witness = nobody
    ) -> dict[str, Node]:
        """Put every vehicle on the road; returns those that are live and not replayed."""
        start_at = self._scenario.start_at_ns
        recorded = {replay.vehicle: replay for replay in replays}
        nodes: dict[str, Node] = {}
        for name in self._scenario.vehicle_names:
            if name in recorded:
                self._actors.append(recorded[name].actor(self.bus, witness))
                continue
            kit = Kit(self._scenario, name)
            node = nodes[name] = kit.node(start_at, self.bus, NoProbe(), witness)
            for sender_key in node.inbox.keys:
                self.bus.subscribe(sender_key, node.inbox.on_bytes)
            self._actors.append(Actor(kit.rates_hz, partial(kit.ticks, start_at), node.step))
        return nodes

    def go(self, stop: Stop) -> None:
        """Let everyone act until the end of the run, or until asked to stop."""
        end_at = self._scenario.start_at_ns + round(self._scenario.duration_s * SECOND)
        for tick, step in in_turn(self._actors):
            if tick.at >= end_at:  # a record may be longer than the run
                break
            self.clock.wait_until(tick.at)
            step(tick)
            if stop.asked:
                return
        self.clock.wait_until(end_at)
