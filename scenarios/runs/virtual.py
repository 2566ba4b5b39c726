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
from scenarios.runs.node.node import AnyNode, VehicleFaultError, step_with_faults
from scenarios.runs.node.outbox import NoProbe
from scenarios.runs.node.sink import Sink
from scenarios.runs.node.vehicle_builder import VehicleBuilder
from transport.bus.bus import MemoryBus
from transport.clock import Tick, VirtualClock
from vehicles.schedule import SECOND

if TYPE_CHECKING:  # only runs with replayed vehicles read logs
    from scenarios.runs.node.recorded_vehicle import Replay
from pathlib import Path

from scenarios.results.drives import DriveRecorder, Trial
from scenarios.results.log_summary import silent_links, summarise
from scenarios.results.metrics import Metrics
from scenarios.results.stream import FigureStream
from scenarios.results.summary import RunIdentity, RunSummary
from scenarios.runs.node.sink import BusSink
from scenarios.runs.observer import ALL_KINDS, Kinds, Listen, Observer, OnMessage, listeners_by_kind
from scenarios.runs.run_log import LimitWatch, RunLog
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.bus.bus import Bus
from transport.log.errors import LogError
from transport.topics import RUN_SENDER
from vehicles.messages import GpsPose, Message, RunStart, TruePose

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


# ---- Virtual runs without a log: the summary that a logged run would have, or the drives


def run_unlogged(scenario: Scenario, observers: Sequence[Observer] = ()) -> RunSummary:
    """Run `scenario` in virtual time; returns the summary that a logged run would have."""
    metrics = Metrics.of(scenario)
    limits = LimitWatch(scenario.tables.limits, metrics)
    outcome = drive(scenario, [metrics, limits, *observers], until=lambda: bool(limits.reason))
    return summarise(
        RunIdentity.here(scenario, "virtual", scenario.virtual_run_id),
        scenario,
        metrics,
        ran_ns=outcome.at - scenario.start_at_ns,
        reason=str(outcome.fault or "")
        or limits.reason
        or silent_links(metrics, off=scenario.off_links),
        rejected={},
    )


def drive_trial(scenario: Scenario, replays: "Sequence[Replay]" = ()) -> Trial:
    """Run `scenario` in virtual time and keep its drives; raises VehicleFaultError."""
    stream = FigureStream.of(scenario)
    drives = DriveRecorder(scenario, stream)
    drive(scenario, [stream, drives], replays=replays).raise_fault()
    return drives.trial()


# ---- `--clock virtual`: a virtual run that writes a log and a summary


def run_virtual(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    *,
    metrics: Metrics | None = None,
    observers: Sequence[Observer] = (),
    replays: "Sequence[Replay]" = (),
) -> RunSummary:
    """Run `scenario` in virtual time and write log and summary into `folder`.

    The log is equal byte for byte for equal arguments, seeds and versions.

    Args:
        scenario: What to simulate.
        folder: Where the files go.
        stop: Ends the run early; a failed run requests a stop with its reason.
        metrics: Figures that the `observers` show; made here otherwise.
        observers: Called for every recorded message, after log and figures.
        replays: Vehicles that send what was recorded, while the others are live.

    """
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=scenario.virtual_run_id,
        metrics=metrics,
        observers=observers,
        replayed=frozenset(replay.vehicle for replay in replays),
    )

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
    at = scenario.start_at_ns
    try:
        outcome = drive(
            scenario,
            log,
            until=lambda: stop.requested or bool(run.early_end_reason),
            replays=replays,
            on_left=log_departure,
        )
        at = outcome.at
        if outcome.fault is not None:
            stop.request(str(outcome.fault), EXIT_FAILED)
    except LogError as error:  # the disk is full, or the log was removed
        at = run.recorder.last_at
        stop.request(str(error), EXIT_FAILED)
    run.end(at, stop.reason)
    summary = run.close(at)
    if summary.reason:  # also of a run that broke a limit and went on to its end
        stop.request(summary.reason, EXIT_FAILED)
    return summary


def record_trial(
    scenario: Scenario,
    folder: Path,
    replays: "Sequence[Replay]" = (),
    observers: Sequence[Observer] = (),
) -> Trial:
    """Run `scenario` as `run_virtual` does and keep its drives; raises LogError if it fails."""
    metrics = Metrics.of(scenario)
    drives = DriveRecorder(scenario, metrics.stream)
    summary = run_virtual(
        scenario,
        folder,
        Stop(),
        metrics=metrics,
        observers=(drives, *observers),
        replays=replays,
    )
    if summary.reason:
        raise LogError(summary.reason)
    return drives.trial()
