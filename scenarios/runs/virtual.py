"""The vehicles of a scenario in one process: nodes over a memory bus, and the order of their steps.

`drive` passes their messages to observers.
"""

import gc
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from heapq import merge
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.link_account import accounts
from scenarios.results.links import silent_links
from scenarios.results.log_summary import summarise
from scenarios.results.summary import RunIdentity, RunSummary
from scenarios.results.tables import KINDS, Collector, RunTables
from scenarios.runs.live import LiveRun
from scenarios.runs.node.node import AnyNode, VehicleFaultError, step_with_faults
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.sink import BusSink, Sink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from scenarios.runs.observer import (
    ALL_KINDS,
    Kinds,
    Listen,
    Observer,
    OnMessage,
    Watcher,
    listeners_by_kind,
)
from scenarios.runs.run_log import RunLog, early_end_of, may_end_early
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.bus.bus import Bus, MemoryBus
from transport.clock import Tick, VirtualClock
from transport.log.errors import LogError
from transport.topics import RUN_SENDER
from vehicles.messages import GpsPose, Message, RunStart, TruePose
from vehicles.schedule import SECOND, Timer

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

    def build(self, sink_of: Callable[[str], Sink]) -> dict[str, AnyNode]:
        """Build every vehicle with its sink; returns the nodes."""
        start_at = self._scenario.start_at_ns
        nodes: dict[str, AnyNode] = {}
        for name in self._scenario.vehicle_names:
            builder = VehicleBuilder(self._scenario, name)
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


# ---- The harness of virtual runs: simulate a scenario and pass its messages to observers


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
    on_left: Callable[[int, str], None] = lambda _at, _vehicle: None,
) -> DriveOutcome:
    """Simulate `scenario` in virtual time, as fast as the machine goes.

    The observers receive the start of the run, the messages of all vehicles and their final
    counters. The result depends on the scenario, its seed and the versions only.

    Args:
        scenario: What to simulate.
        observers: Called in this order for each message.
        until: Ends the run early once it is true; evaluated after each step of a vehicle.
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

    nodes = convoy.build(sink_of)
    fault = None
    try:
        convoy.run(until)
    except VehicleFaultError as error:
        fault = error
    for name, node in nodes.items():
        if name not in convoy.left:  # a vehicle that left has sent its final counters
            node.outbox.publish_health(now(), final=True)
    return DriveOutcome(now(), fault)


# ---- Virtual runs without a log: their tables, and the summary that a logged run would have


STAGE_NS = 2 * SECOND
"""Run time between two evaluations of a running simulation."""


def run_tables(
    scenario: Scenario,
    *,
    kinds: Kinds = KINDS,
    is_over: Callable[[RunTables], bool] | None = None,
) -> tuple[RunTables, DriveOutcome]:
    """Run `scenario` in virtual time; returns its tables of messages of some `kinds`.

    The run ends early once `is_over` of the tables so far, which is evaluated every STAGE_NS.
    """
    collector, timer = Collector(kinds), Timer(STAGE_NS)

    def ends() -> bool:
        if is_over is None or not timer.is_due(collector.last_at):
            return False
        so_far = collector.last_at - scenario.start_at_ns
        return is_over(RunTables(scenario, collector.tables(), so_far))

    outcome = drive(scenario, [collector], until=ends)
    ran_ns = outcome.at - scenario.start_at_ns
    return RunTables(scenario, collector.tables(), ran_ns), outcome


def run_unlogged(scenario: Scenario, observers: Sequence[Observer] = ()) -> RunSummary:
    """Run `scenario` in virtual time; returns the summary that a logged run would have."""
    collector, live, timer = Collector(), LiveRun(scenario), Timer(STAGE_NS)
    watched: list[Observer] = [collector, *observers]
    if may_end_early(scenario):
        watched.append(live)

    def ends() -> bool:
        return timer.is_due(collector.last_at) and live.update() and bool(early_end_of(live))

    outcome = drive(scenario, watched, until=ends if live in watched else never)
    run = RunTables(scenario, collector.tables(), outcome.at - scenario.start_at_ns)
    if live in watched:
        live.update()
    early = early_end_of(live)
    if early is not None:
        run = run.until(early.at_ns)
    ended = early.reason if early else silent_links(run, accounts(run))
    return summarise(
        RunIdentity.here(scenario, "virtual", scenario.virtual_run_id),
        run,
        reason=str(outcome.fault or "") or ended,
        rejected={},
    )


# ---- `--clock virtual`: a virtual run that writes a log and a summary


def run_virtual(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    *,
    watchers: Sequence[Watcher] = (),
    observers: Sequence[Observer] = (),
) -> RunSummary:
    """Run `scenario` in virtual time and write log and summary into `folder`.

    The log is equal byte for byte for equal arguments, seeds and versions.

    Args:
        scenario: What to simulate.
        folder: Where the files go.
        stop: Ends the run early; a failed run requests a stop with its reason.
        watchers: Called after each evaluation of the last seconds.
        observers: Called for every recorded message, after the log.

    """
    live = LiveRun(scenario)
    is_evaluated = bool(watchers) or may_end_early(scenario)
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=scenario.virtual_run_id,
        live=live,
        observers=[*([live] if is_evaluated else []), *observers],
    )
    timer = Timer(STAGE_NS)

    def ends(*, is_last: bool = False) -> bool:
        at = run.recorder.last_at
        if is_evaluated and (is_last or timer.is_due(at)) and run.update(at):
            for watcher in watchers:
                watcher.update(live)
        return stop.requested or run.early_end is not None

    try:
        outcome = _simulated(scenario, run, ends)
        at = outcome.at
        ends(is_last=True)
        if outcome.fault is not None:
            stop.request(str(outcome.fault), EXIT_FAILED)
    except LogError as error:  # the disk is full, or the log was removed
        at = run.recorder.last_at or scenario.start_at_ns
        stop.request(str(error), EXIT_FAILED)
    run.end(at, stop.reason)
    for watcher in watchers:
        watcher.update(live)
    summary = run.close(at)
    if summary.reason:  # also of a run that broke a limit and went on to its end
        stop.request(summary.reason, EXIT_FAILED)
    return summary


def _simulated(scenario: Scenario, run: RunLog, ends: Callable[[], bool]) -> DriveOutcome:
    """Simulate a scenario into the log of a run; raises LogError."""

    def begin(at: int, start: Message) -> None:
        if isinstance(start, RunStart):
            run.start(at, start.start_at_ns)

    def log_departure(at: int, vehicle: str) -> None:
        after_s = (at - scenario.start_at_ns) / SECOND
        line = f"{vehicle} left {after_s:.1f} s after the start; the convoy continues without it"
        run.recorder.log(at, line)

    log = (
        OnMessage(begin, frozenset({RunStart})),
        OnMessage(run.recorder.record, ALL_KINDS - {RunStart}),
    )
    return drive(scenario, log, until=ends, on_left=log_departure)
