"""Convoys in virtual time without a log: commands and true motion of each car."""

from collections import defaultdict
from dataclasses import dataclass, field

from scenarios.definition.scenario import Scenario
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive as virtual_drive
from vehicles.messages import Command, LogText, Message, TruePose


@dataclass
class Driven:
    truth: defaultdict[str, list[TruePose]] = field(default_factory=lambda: defaultdict(list))
    commands: defaultdict[str, list[Command]] = field(default_factory=lambda: defaultdict(list))
    texts: defaultdict[str, list[LogText]] = field(default_factory=lambda: defaultdict(list))

    def take(self, _at: int, message: Message) -> None:
        match message:
            case TruePose():
                self.truth[message.vehicle].append(message)
            case Command():
                self.commands[message.vehicle].append(message)
            case LogText():
                self.texts[message.vehicle].append(message)


def drive(scenario: Scenario) -> Driven:
    driven = Driven()
    virtual_drive(scenario, [OnMessage(driven.take)]).raise_fault()
    return driven
