"""Convoys with `[[change]]` entries, run in virtual time with all their messages."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.runs.node.node import AnyNode, step_with_faults
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.observer import OnMessage, listeners_by_kind
from scenarios.runs.virtual import ObservedSink, Stepper, steps_in_order
from transport.bus.bus import MemoryBus
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
    entries = "".join(f"[[change]]\n{change}\n" for change in changes)
    return scenario_from_text(f"{ROAD}\n{rest}\n{entries}", overrides=overrides)


@dataclass
class ChangedConvoy:
    """A convoy in virtual time: its nodes, and all messages in the order of sending.

    A node can be replaced between two ticks.
    """

    scenario: Scenario
    sent: list[Message] = field(default_factory=list)
    nodes: dict[str, AnyNode] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.start_at = self.scenario.start_at_ns
        self.bus = MemoryBus()
        self.builders = {n: VehicleBuilder(self.scenario, n) for n in self.scenario.vehicle_names}
        for name, builder in self.builders.items():
            self.set_node(name, builder.node(self.start_at, self.sink(name), NoProbe()))

    def sink(self, name: str) -> ObservedSink:
        keep = OnMessage(lambda _, message: self.sent.append(message))
        return ObservedSink(name, self.bus, lambda: 0, listeners_by_kind([keep]))

    def set_node(self, name: str, node: AnyNode) -> None:
        if name not in self.nodes:
            for key in node.inbox.keys:
                self.bus.subscribe(key, partial(self._receive, name))
        self.nodes[name] = node

    def _receive(self, name: str, key: str, data: bytes) -> None:
        self.nodes[name].inbox.on_bytes(key, data)

    def _step(self, name: str, tick: Tick) -> None:
        step_with_faults(self.nodes[name], name, self.start_at)(tick)

    def steps(self) -> list[Stepper]:
        return [
            Stepper(builder.schedule, partial(builder.ticks, self.start_at), partial(self._step, n))
            for n, builder in self.builders.items()
        ]

    def run(self) -> "ChangedConvoy":
        for tick, step in steps_in_order(self.steps()):
            step(tick)
        return self

    def of(self, vehicle: str, kind: type[Message]) -> list[Any]:
        return [m for m in self.sent if m.vehicle == vehicle and type(m) is kind]

    def truths(self, vehicle: str) -> dict[float, TruePose]:
        return {
            round((pose.true_at_ns - self.start_at) / 1e9, 6): pose
            for pose in self.of(vehicle, TruePose)
        }
