"""A virtual run whose drives stay in memory, with or without a log; vehicles may be replayed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.results.drives import Diary, Trial
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.probe import NoProbe
from scenarios.runs.recorder import Listener
from scenarios.runs.replay import Replay
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import World, run_virtual
from vehicles.driver.decision import Decision
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose, Message


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
    world, diary = World(scenario), Diary()
    for name, node in world.populate(replays).items():
        node.outbox = Notes(
            diary,
            vehicle=name,
            bus=world.bus,
            plane=LocalPlane(scenario.origin),
            inbox=node.inbox,
            probe=NoProbe(),
            start_at=scenario.start_at_ns,
        )
    for replay in replays:
        for message in replay.messages:
            diary.listen(message)
    world.go(Stop())
    return diary.trial(scenario)


def record(
    scenario: Scenario,
    folder: Path,
    replays: Sequence[Replay] = (),
    listeners: Sequence[Listener] = (),
) -> Trial:
    """Run `scenario` in virtual time and write its log and summary into `folder`.

    Each of `listeners` gets every recorded message.
    """
    diary = Diary()
    run_virtual(
        scenario,
        folder,
        Stop(),
        listeners=(lambda _, message: diary.listen(message), *listeners),
        replays=replays,
    )
    return diary.trial(scenario)
