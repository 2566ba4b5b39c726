"""Convoys to which something is done, driven in virtual time with all that they send."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.node.assembly.vehicle_builder import VehicleBuilder
from scenarios.runs.node.node import Node, step_with_faults
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.node.replayed_node import ReplayedNode
from scenarios.runs.observer import OnMessage, listeners_by_kind
from scenarios.runs.virtual.drive import ObservedSink
from scenarios.runs.virtual.virtual_convoy import Stepper, steps_in_order
from transport.bus.memory_bus import MemoryBus
from transport.clock import Tick
from vehicles.messages import Message, TruePose

ROAD = """
name = "changed"
duration_s = 6.0
[convoy]
vehicles = 3
[speed]
set_mps = 15.0
[path]
kind = "segments"
segments = [{ length_m = 30.0 }, { length_m = 40.0, radius_m = 120.0, turn = "left" },
            { length_m = 1000.0 }]
"""


def changed(*changes: str, rest: str = "", overrides: Sequence[str] = ()) -> Scenario:
    """The road with one `[[change]]` of each text in `changes`."""
    entries = "".join(f"[[change]]\n{one}\n" for one in changes)
    return scenario_from_text(f"{ROAD}\n{rest}\n{entries}", overrides=overrides)


@dataclass
class ChangedConvoy:
    """A convoy in virtual time: its nodes, and all messages in the order in which they were sent.

    Between two ticks a node can be exchanged for another one.
    """

    scenario: Scenario
    sent: list[Message] = field(default_factory=list)
    nodes: dict[str, Node | ReplayedNode] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Build the vehicles."""
        self.start_at = self.scenario.start_at_ns
        self.bus = MemoryBus()
        self.builders = {n: VehicleBuilder(self.scenario, n) for n in self.scenario.vehicle_names}
        for name, builder in self.builders.items():
            self.put(name, builder.node(self.start_at, self.sink(name), NoProbe()))

    def sink(self, name: str) -> ObservedSink:
        """Where the messages of a vehicle go; only poses are encoded, which the others hear."""
        keep = OnMessage(lambda _, message: self.sent.append(message))
        return ObservedSink(name, self.bus, lambda: 0, listeners_by_kind([keep]))

    def put(self, name: str, node: Node | ReplayedNode) -> None:
        """Let `node` be the vehicle from now on."""
        if name not in self.nodes:
            for key in node.inbox.keys:
                self.bus.subscribe(key, partial(self._hear, name))
        self.nodes[name] = node

    def _hear(self, name: str, key: str, data: bytes) -> None:
        self.nodes[name].inbox.on_bytes(key, data)

    def _step(self, name: str, tick: Tick) -> None:
        step_with_faults(self.nodes[name], name, self.start_at)(tick)

    def steps(self) -> list[Stepper]:
        """What the vehicles do."""
        return [
            Stepper(builder.schedule, partial(builder.ticks, self.start_at), partial(self._step, n))
            for n, builder in self.builders.items()
        ]

    def run(self) -> "ChangedConvoy":
        """Drive to the end."""
        for tick, step in steps_in_order(self.steps()):
            step(tick)
        return self

    def of(self, vehicle: str, kind: type[Message]) -> list[Any]:
        """All messages of one kind from a vehicle."""
        return [one for one in self.sent if one.vehicle == vehicle and type(one) is kind]

    def truths(self, vehicle: str) -> dict[float, TruePose]:
        """True poses of a vehicle, by seconds after the start."""
        return {
            round((one.true_at_ns - self.start_at) / 1e9, 6): one
            for one in self.of(vehicle, TruePose)
        }
