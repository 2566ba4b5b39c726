"""A virtual run whose drives stay in memory, with or without a log; vehicles may be replayed."""

from collections.abc import Callable, Container, Sequence
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import KINDS, DriveRecorder, Trial
from scenarios.runs.recorder import Listener
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.convoy import VirtualConvoy
from scenarios.runs.virtual.logged import run_virtual
from scenarios.runs.virtual.replay import Replay
from scenarios.runs.virtual.unlogged import FiguresSink
from transport.log.records import LogError
from vehicles.messages import GpsPose, Message


class RehearsalSink(FiguresSink):
    """Publishes the pose for the convoy and gives the rest to whoever listens, not encoded."""

    def send(self, message: Message) -> None:
        """Take one message; a pose waits until `flush`."""
        if isinstance(message, GpsPose):
            self._to_convoy.send(message)
        else:
            self._take(message)


def rehearse(scenario: Scenario, replays: Sequence[Replay] = ()) -> Trial:
    """Run `scenario` in virtual time without a log, in about half the time that one takes.

    Vehicles in `replays` send what was recorded, the others are live. What is received, and so
    what the vehicles do, is the same as in a logged run.
    """
    drives = DriveRecorder()
    overhear(scenario, drives.listen, replays, KINDS)
    return drives.trial(scenario)


def overhear(
    scenario: Scenario,
    listen: Callable[[Message], None],
    replays: Sequence[Replay] = (),
    kinds: Container[type[Message]] | None = None,
) -> None:
    """Run `scenario` in virtual time without a log; `listen` gets all that is not a pose.

    If it reads only some `kinds` of message, others need not be made.
    """
    convoy = VirtualConvoy(scenario)
    convoy.build(lambda vehicle: RehearsalSink(vehicle, convoy.bus, listen, kinds), replays)
    convoy.run(Stop())


def record(
    scenario: Scenario,
    folder: Path,
    replays: Sequence[Replay] = (),
    listeners: Sequence[Listener] = (),
) -> Trial:
    """Run `scenario` in virtual time and write its log and summary into `folder`.

    Each of `listeners` gets every recorded message. Raises LogError if they cannot be written.
    """
    drives = DriveRecorder()
    summary = run_virtual(
        scenario,
        folder,
        Stop(),
        listeners=(lambda _, message: drives.listen(message), *listeners),
        replays=replays,
    )
    if summary.reason:
        raise LogError(summary.reason)
    return drives.trial(scenario)
