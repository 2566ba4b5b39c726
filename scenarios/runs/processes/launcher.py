"""`convoy run` on the wall clock: a router, a process per vehicle, a recorder, and their watch."""

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.log_summary import LOG_NAME
from scenarios.runs.processes.supervisor import Child, Supervisor
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.log.mcap_log import LogError, repair

WATCH_PERIOD_S = 0.05


@dataclass(frozen=True, slots=True)
class Launch:
    """What to launch: the scenario, the arguments that name it again, and where to write."""

    scenario: Scenario
    scenario_arguments: Sequence[str]
    folder: Path
    recorder_arguments: Sequence[str]


@dataclass(slots=True)
class Fate:
    """How the run ended: exit code and, if not as planned, the line that says why.

    `repaired` says that the recorder could not complete its log, and that this was done for it.
    """

    exit_code: int = 0
    reason: str = ""
    repaired: bool = False

    def fail(self, reason: str, exit_code: int = EXIT_FAILED) -> None:
        """End the run; the first failure decides."""
        if not self.reason:
            self.reason, self.exit_code = reason, exit_code


def launch(plan: Launch, stop: Stop) -> Fate:
    """Run the convoy to its end and leave no process behind."""
    supervisor = Supervisor()
    fate = Fate()
    try:
        endpoint = supervisor.start_router()
        recorder = supervisor.start(
            "recorder",
            [
                *("record", *plan.scenario_arguments, "--leash", "-e", endpoint),
                *("--out", str(plan.folder), *plan.recorder_arguments),
            ],
        )
        for name in plan.scenario.vehicle_names:
            supervisor.start(
                name,
                ["vehicle", *plan.scenario_arguments, "--leash", "--name", name, "-e", endpoint],
            )
        _watch(plan, supervisor, recorder, stop, fate)
    finally:
        _wind_up(plan, supervisor, fate)
    return fate


def _watch(plan: Launch, supervisor: Supervisor, recorder: Child, stop: Stop, fate: Fate) -> None:
    """Return when the run is over: as planned, as asked, or because something died."""
    vehicles = plan.scenario.vehicle_names
    go_on = plan.scenario.goes_on_without_the_dead
    while not fate.reason:
        if stop.asked:
            fate.fail(stop.reason, stop.exit_code)
        for child in supervisor.ended():
            if child is recorder and child.exit_code == 0:
                return
            if child is recorder and child.exit_code == EXIT_FAILED:
                fate.fail("the run failed, see above")
            elif child.name not in vehicles or (child.exit_code != 0 and not go_on):
                fate.fail(f"{child.fate()}; the run ends")
        time.sleep(WATCH_PERIOD_S)


def _wind_up(plan: Launch, supervisor: Supervisor, fate: Fate) -> None:
    """Stop what still runs: the vehicles first, so that the recorder gets their last words."""
    supervisor.tell("recorder", fate.reason)
    names = [child.name for child in supervisor.children]
    supervisor.stop([name for name in names if name in plan.scenario.vehicle_names], grace_s=1.0)
    supervisor.stop(["recorder"], grace_s=2.5)
    supervisor.stop(grace_s=0.5)
    log = plan.folder / LOG_NAME
    with suppress(LogError):  # killed before it had begun its log
        fate.repaired = log.exists() and repair(log)
