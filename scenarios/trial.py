"""A virtual run whose drives stay in memory, with or without a log; vehicles may be replayed."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any

from scenarios.assembly import Kit
from scenarios.drives import Diary, Trial
from scenarios.node import Node
from scenarios.outbox import Outbox
from scenarios.probe import NoProbe
from scenarios.replay import Replay
from scenarios.run_log import RunLog
from scenarios.scenario import Scenario
from transport.bus import Bus
from transport.clock import VirtualClock
from transport.memory_bus import MemoryBus
from vehicles.decision import Decision
from vehicles.geodesy import LocalPlane
from vehicles.messages import GpsPose, Message
from vehicles.schedule import SECOND

Event = tuple[int, int, Callable[[], None]]
"""When (ns), whose turn among those of one instant, and what happens."""


class Notes(Outbox):
    """Says its pose to the convoy as ever, and notes the rest in a diary instead of sending it."""

    def __init__(self, diary: Diary, **parts: Any) -> None:
        """`parts` are those of an Outbox."""
        super().__init__(**parts)
        self._diary = diary

    def _publish_decision(self, now: int, decision: Decision) -> None:  # noqa: ARG002
        self._diary.note(self._vehicle, decision.errors.lateral, decision.errors.heading)

    def _send(self, message: Message) -> None:
        if isinstance(message, GpsPose):
            super()._send(message)
        else:
            self._diary.listen(message)


def rehearse(scenario: Scenario, replays: Sequence[Replay] = ()) -> Trial:
    """Run `scenario` in virtual time without a log, in half the time that one takes.

    Vehicles in `replays` say what was recorded, the others are live. What is heard, and so what
    the vehicles do, is the same as in a logged run.
    """
    start_at, bus, diary = scenario.start_at_ns, MemoryBus(), Diary()
    live = _live(scenario, bus, replays)
    for kit, node in live:
        node.outbox = Notes(
            diary,
            vehicle=kit.name,
            bus=bus,
            plane=LocalPlane(scenario.origin),
            inbox=node.inbox,
            probe=NoProbe(),
            start_at=start_at,
        )
    for replay in replays:
        for message in replay.messages:
            diary.listen(message)
    _go(scenario, bus, VirtualClock(start_at), live, replays)
    return diary.trial(scenario)


def record(scenario: Scenario, folder: Path, replays: Sequence[Replay] = ()) -> Trial:
    """Run `scenario` in virtual time and write its log and summary into `folder`.

    Without `replays` the log is that of `convoy run --clock virtual`, byte for byte.
    """
    start_at, bus, diary = scenario.start_at_ns, MemoryBus(), Diary()
    clock = VirtualClock(start_at)
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=f"{scenario.name}-{scenario.seed}",
        listeners=(lambda _, message: diary.listen(message),),
    )
    bus.subscribe("convoy/**", lambda key, data: run.recorder.accept(key, data, clock.now()))
    run.start(start_at, start_at)
    live = _live(scenario, bus, replays)
    _go(scenario, bus, clock, live, replays)
    for _, node in live:
        node.outbox.publish_health(clock.now(), final=True)
    run.end(clock.now(), "")
    run.close(clock.now())
    return diary.trial(scenario)


def _live(scenario: Scenario, bus: Bus, replays: Sequence[Replay]) -> list[tuple[Kit, Node]]:
    """Put together every vehicle that is not replayed."""
    replayed = {replay.vehicle for replay in replays}
    kits = [Kit(scenario, name) for name in scenario.vehicle_names if name not in replayed]
    return [(kit, kit.node(scenario.start_at_ns, bus, NoProbe())) for kit in kits]


def _go(
    scenario: Scenario,
    bus: Bus,
    clock: VirtualClock,
    live: Sequence[tuple[Kit, Node]],
    replays: Sequence[Replay],
) -> None:
    """Let all events of the run happen in order of time, at one instant from the lead back."""
    end_at = scenario.start_at_ns + round(scenario.duration_s * SECOND)
    place = scenario.vehicle_names.index
    for _, node in live:
        for sender_key in node.inbox.keys:
            bus.subscribe(sender_key, node.inbox.on_bytes)
    events = [
        *(_ticks(kit, node, scenario, place(kit.name)) for kit, node in live),
        *(_said(replay, bus, place(replay.vehicle)) for replay in replays),
    ]
    for at, _, happen in merge(*events, key=itemgetter(0, 1)):
        if at >= end_at:  # a record may be longer than the run
            break
        clock.wait_until(at)
        happen()
    clock.wait_until(end_at)


def _ticks(kit: Kit, node: Node, scenario: Scenario, place: int) -> Iterator[Event]:
    ticks = kit.ticks(scenario.start_at_ns)
    return ((tick.at, place, partial(node.step, tick)) for tick in ticks)


def _said(replay: Replay, bus: Bus, place: int) -> Iterator[Event]:
    return ((at, place, partial(replay.publish, message, bus)) for at, message in replay.events())
