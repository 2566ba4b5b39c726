"""The vehicles of a scenario in one process: nodes over a memory bus, and the order of their steps.

`drive` passes their messages to observers.
"""

import gc
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from heapq import merge
from typing import TYPE_CHECKING

from scenarios.definition.scenario import Scenario
from scenarios.runs.node.assembly.vehicle_builder import VehicleBuilder
from scenarios.runs.node.node import AnyNode, VehicleFaultError, step_with_faults
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.node.sink import Sink
from transport.bus.memory_bus import MemoryBus
from transport.clock import Tick, VirtualClock
from vehicles.schedule import SECOND

if TYPE_CHECKING:  # only runs with replayed vehicles read logs
    from scenarios.runs.node.recorded_vehicle import Replay

Step = Callable[[Tick], None]
COLLECTED_EVERY = 50_000
"""Threshold of the garbage collector during a run."""


@contextmanager
def rarely_collected() -> Iterator[None]:
    """Run the garbage collector rarely: a run makes many objects and few reference cycles."""
    before = gc.get_threshold()
    gc.set_threshold(COLLECTED_EVERY if before[0] else 0, *before[1:])  # 0: it is switched off
    try:
        yield
    finally:
        gc.set_threshold(*before)


def never() -> bool:
    return False


@dataclass(frozen=True, slots=True)
class Stepper:
    """Makes a `step` at each of its `ticks`; equal `schedule`s have equal ticks."""

    schedule: Hashable
    ticks: Callable[[], Iterator[Tick]]
    step: Step


def steps_in_order(steppers: Sequence[Stepper]) -> Iterator[tuple[Tick, Step]]:
    """Yield all steps in order of time, at equal instants in the order of `steppers`."""
    if len({stepper.schedule for stepper in steppers}) == 1:
        # The usual case: what follows gives the same, but more slowly.
        steps = [stepper.step for stepper in steppers]
        for tick in steppers[0].ticks():
            for step in steps:
                yield tick, step
        return

    def of_one(place: int) -> Iterator[tuple[int, int, Tick]]:
        return ((tick.at, place, tick) for tick in steppers[place].ticks())

    for _, place, tick in merge(*map(of_one, range(len(steppers)))):
        yield tick, steppers[place].step


class VirtualConvoy:
    """The vehicles of a scenario in one process, with a common bus and clock.

    `left` are failed vehicles without which the others continue.
    """

    def __init__(
        self,
        scenario: Scenario,
        on_left: Callable[[int, str], None] = lambda _at, _vehicle: None,
    ) -> None:
        """`on_left` gets the instant (ns) and the name of a vehicle that leaves."""
        self.bus = MemoryBus()
        self.clock = VirtualClock(scenario.start_at_ns)
        self._scenario = scenario
        self._steppers: list[Stepper] = []
        self.left: set[str] = set()
        self._on_left = on_left

    def build(
        self, sink_of: Callable[[str], Sink], replays: "Sequence[Replay]" = ()
    ) -> dict[str, AnyNode]:
        """Build every vehicle with its sink; returns the nodes.

        `replays` replace vehicles, in addition to those that the scenario replays.
        """
        start_at = self._scenario.start_at_ns
        recorded = {replay.vehicle: replay for replay in replays}
        nodes: dict[str, AnyNode] = {}
        for name in self._scenario.vehicle_names:
            builder = VehicleBuilder(self._scenario, name, recorded.get(name))
            node = nodes[name] = builder.node(start_at, sink_of(name), NoProbe())
            for sender_key in node.inbox.keys:
                self.bus.subscribe(sender_key, node.inbox.on_bytes)
            if builder.target is not None:
                self.bus.subscribe(builder.target.key, builder.target.on_bytes)
            ticks = partial(builder.ticks, start_at)
            step = step_with_faults(node, name, start_at)
            if self._scenario.continues_without_failed:
                step = self._leaving(step, name, nodes)
            self._steppers.append(Stepper(builder.schedule, ticks, step))
        return nodes

    def _leaving(self, step: Step, name: str, nodes: Mapping[str, AnyNode]) -> Step:
        """Return `step` of a vehicle that leaves when it fails, unless it is the last one."""

        def step_or_leave(tick: Tick) -> None:
            if name in self.left:
                return
            try:
                step(tick)
            except VehicleFaultError as fault:
                if self.left | {name} >= nodes.keys():
                    raise
                self.left.add(name)
                outbox = nodes[name].outbox
                outbox.log(tick.at, fault.text, "fatal")
                self._on_left(tick.at, name)
                outbox.publish_health(tick.at, final=True)

        return step_or_leave

    def run(self, until: Callable[[], bool] = never) -> None:
        """Step all vehicles to the end of the run, or until `until` is true.

        Raises VehicleFaultError if a vehicle fails and the others do not continue without it.
        """
        end_at = self._scenario.start_at_ns + round(self._scenario.duration_s * SECOND)
        with rarely_collected():
            for tick, step in steps_in_order(self._steppers):
                self.clock.wait_until(tick.at)
                step(tick)
                if until():
                    return
        self.clock.wait_until(end_at)
