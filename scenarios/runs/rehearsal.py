"""A virtual run whose drives stay in memory, with or without a log; vehicles may be replayed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import DriveRecorder, Trial
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.replay import Replay
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import World, run_virtual
from vehicles.driver.decision import Decision
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose, Message


class Notes(Outbox):
    """Broadcasts the pose as ever, and gives the rest to a DriveRecorder instead of sending it."""

    def __init__(self, drives: DriveRecorder, **parts: Any) -> None:
        """`parts` are those of an Outbox."""
        super().__init__(**parts)
        self._drives = drives

    def _publish_decision(self, now: int, decision: Decision) -> None:  # noqa: ARG002
        self._drives.add_errors(self._vehicle, decision.errors.lateral, decision.errors.heading)

    def _send(self, message: Message) -> None:
        if isinstance(message, GpsPose):
            super()._send(message)
        else:
            self._drives.listen(message)


def rehearse(scenario: Scenario, replays: Sequence[Replay] = ()) -> Trial:
    """Run `scenario` in virtual time without a log, in half the time that one takes.

    Vehicles in `replays` say what was recorded, the others are live. What is heard, and so what
    the vehicles do, is the same as in a logged run.
    """
    world, drives = World(scenario), DriveRecorder()
    for name, node in world.populate(replays).items():
        node.outbox = Notes(
            drives,
            vehicle=name,
            bus=world.bus,
            plane=LocalPlane(scenario.origin),
            inbox=node.inbox,
            probe=NoProbe(),
            start_at=scenario.start_at_ns,
        )
    for replay in replays:
        for message in replay.messages:
            drives.listen(message)
    world.go(Stop())
    return drives.trial(scenario)


def record(scenario: Scenario, folder: Path, replays: Sequence[Replay] = ()) -> Trial:
    """Run `scenario` in virtual time and write its log and summary into `folder`."""
    drives = DriveRecorder()
    run_virtual(
        scenario,
        folder,
        Stop(),
        listeners=(lambda _, message: drives.listen(message),),
        replays=replays,
    )
    return drives.trial(scenario)
