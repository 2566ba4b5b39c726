"""Requested crash of a vehicle's process: its software is built again from the scenario.

Only the car and the clock are handed over.
"""

from dataclasses import dataclass

from scenarios.runs.node.node import SoftwareHandover
from scenarios.runs.node.process_probe import Lateness
from transport.clock import ClockSetting


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessHandover:
    """State that a vehicle's process passes to its successor.

    `start_at` (ns) and `run_id` are those of the run, `clock` is the setting of the process's
    clock, `lateness` that of its ticks so far. `changes` are messages on changes by hand, with
    their keys.
    """

    start_at: int
    run_id: str
    clock: ClockSetting
    lateness: Lateness
    changes: tuple[tuple[str, bytes], ...] = ()
    node: SoftwareHandover


class RestartRequestedError(Exception):
    """The process has to restart with `handover`."""

    def __init__(self, handover: ProcessHandover) -> None:
        self.handover = handover
        super().__init__("the process restarts")
