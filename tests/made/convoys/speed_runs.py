"""Convoys in virtual time without a log: what each car was told, and how it truly moved."""

from collections import defaultdict
from dataclasses import dataclass, field

from scenarios.definition.scenario import Scenario
from scenarios.runs.node.sink import BusSink
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import VirtualConvoy
from vehicles.messages import Command, GpsPose, LogText, Message, TruePose


@dataclass
class Driven:
    """True poses, commands and lines of the log by vehicle."""

    truth: defaultdict[str, list[TruePose]] = field(default_factory=lambda: defaultdict(list))
    commands: defaultdict[str, list[Command]] = field(default_factory=lambda: defaultdict(list))
    texts: defaultdict[str, list[LogText]] = field(default_factory=lambda: defaultdict(list))


def drive(scenario: Scenario) -> Driven:
    """Drive `scenario` to its end; only poses are encoded, which the others hear."""
    convoy, driven = VirtualConvoy(scenario), Driven()

    class Kept:
        """A sink; not one that inherits, which where it is compiled it could not."""

        def __init__(self, vehicle: str) -> None:
            self._poses = BusSink(vehicle, convoy.bus)
            self.flush, self.reads = self._poses.flush, self._poses.reads

        def send(self, message: Message) -> None:
            match message:
                case GpsPose():
                    self._poses.send(message)
                case TruePose():
                    driven.truth[message.vehicle].append(message)
                case Command():
                    driven.commands[message.vehicle].append(message)
                case LogText():
                    driven.texts[message.vehicle].append(message)

    convoy.build(Kept)
    convoy.run(Stop())
    return driven
