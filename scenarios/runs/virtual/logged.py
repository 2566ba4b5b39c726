"""`--clock virtual`: the same nodes in one process over a memory bus, as fast as they go."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.definition.scenario import Scenario
from scenarios.results.metrics import Metrics
from scenarios.results.summary import RunSummary
from scenarios.runs.node.fault import VehicleFaultError
from scenarios.runs.node.sink import RecordedSink
from scenarios.runs.recorder import Listener, Selective
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual.convoy import VirtualConvoy
from transport.log.message_log import MessageLog
from transport.log.records import LogError
from transport.topics import Topic
from vehicles.messages import LogText, Message, TruePose
from vehicles.schedule import SECOND

if TYPE_CHECKING:  # what reads logs is for those who have some
    from scenarios.runs.virtual.replay import Replay


def run_virtual(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    *,
    metrics: Metrics | None = None,
    listeners: Sequence[Listener] = (),
    replays: "Sequence[Replay]" = (),
    writer: MessageLog | None = None,
) -> RunSummary:
    """Run `scenario` in virtual time into `folder`; returns the summary.

    Vehicles in `replays` send what was recorded, the others are live. The `writer` of the log is
    given if that has been begun. Depends on nothing but these, the scenario, its seed and the
    versions: the log is equal byte for byte.
    """
    convoy = VirtualConvoy(scenario)
    clock = convoy.clock
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id=scenario.virtual_run_id,
        metrics=metrics,
        listeners=(*listeners, *_watching(scenario, stop, lambda: run)),
        replayed=frozenset(replay.vehicle for replay in replays),
        writer=writer,
    )

    on_sent, now = run.recorder.on_sent, clock.now

    def record(topic: Topic, data: bytes | None, message: Message) -> None:
        on_sent(topic, data, message, now())

    run.start(clock.now(), clock.now())
    nodes = convoy.build(lambda vehicle: RecordedSink(vehicle, convoy.bus, record), replays)
    try:
        try:
            convoy.run(stop)
        except VehicleFaultError as fault:
            stop.ask(str(fault), EXIT_FAILED)
        for name, node in nodes.items():
            if name not in convoy.left:  # those have said their last words
                node.outbox.publish_health(clock.now(), final=True)
    except LogError as error:  # the disk is full, or the log was removed
        stop.ask(str(error), EXIT_FAILED)
    run.end(clock.now(), stop.reason)
    summary = run.close(clock.now())
    if summary.reason:  # a limit can also be broken by a run that went on to its end
        stop.ask(summary.reason, EXIT_FAILED)
    return summary


def _watching(scenario: Scenario, stop: Stop, run: Callable[[], RunLog]) -> tuple[Listener, ...]:
    """Listeners that say who has left, and end a run as soon as its limits are broken."""

    def tell_of_leaving(at: int, text: Message) -> None:
        if isinstance(text, LogText) and text.ends_vehicle:
            left = f"{text.vehicle} left {(at - scenario.start_at_ns) / SECOND:.1f} s"
            run().recorder.say(at, f"{left} after the start; the convoy goes on without it")

    def end_by_limits(_at: int, _pose: Message) -> None:
        if (reason := run().must_end) and not stop.asked:
            stop.ask(reason, EXIT_FAILED)

    return (
        Selective(frozenset({LogText}), tell_of_leaving),
        Selective(frozenset({TruePose}), end_by_limits),  # nothing else brings collisions
    )
