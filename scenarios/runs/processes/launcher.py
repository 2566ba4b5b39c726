"""`convoy run` on the wall clock: starts a router, a recorder and a process per vehicle."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.runs.control.open_runs import OpenRun, announced
from scenarios.runs.processes.supervisor import Child, Supervisor, describe
from scenarios.runs.stop import EXIT_FAILED, Stop
from transport.bus.bus import BusError
from transport.clock import SYSTEM_TIME, SystemTime, poll

WATCH_PERIOD_S = 0.05
NOTICED_S = 0.1
"""Time in which each process notices that its router has ended, on a busy machine too."""
ROUTER, RECORDER = "router", "recorder"
RECORDER_FAILED = "the run failed"
"""Reason of a run whose recorder has printed the true one."""


@dataclass(frozen=True, slots=True)
class LaunchPlan:
    """What to launch: scenario, the arguments that select it, folder, name of the run."""

    scenario: Scenario
    scenario_arguments: Sequence[str]
    folder: Path
    recorder_arguments: Sequence[str]
    run: str


@dataclass(slots=True)
class RunOutcome:
    """How a run ended: exit code, and the reason of a failure.

    `repaired`: the launcher completed the log that the recorder could not. `recorder_killed`: by a
    signal, perhaps after its log was complete. `router_ended`: the run
    failed by that, unless its recorder knows better. `is_reported`: the reason is printed already.
    """

    exit_code: int = 0
    reason: str = ""
    repaired: bool = False
    recorder_killed: bool = False
    router_ended: bool = False
    is_reported: bool = False

    def fail(self, reason: str, exit_code: int = EXIT_FAILED, *, is_reported: bool = False) -> None:
        """End the run; the first failure decides."""
        if not self.reason:
            self.reason, self.exit_code, self.is_reported = reason, exit_code, is_reported


def launch(
    plan: LaunchPlan,
    stop: Stop,
    supervisor: Supervisor,
    complete: Callable[[Path], bool],
    *,
    on_router: Callable[[str], None] = lambda _: None,
    system: SystemTime = SYSTEM_TIME,
) -> RunOutcome:
    """Run the convoy to its end and leave no process behind.

    `complete` completes the log where the recorder could not; it returns whether that was needed.
    `on_router` gets the router's endpoint.
    """
    outcome = RunOutcome()
    recorder: Child | None = None
    try:
        endpoint = supervisor.start_router()
        on_router(endpoint)
        common = (*plan.scenario_arguments, "--parent-watch", "--run", plan.run, "-e", endpoint)
        recorder = supervisor.start(
            RECORDER,
            ["record", *common, "--out", str(plan.folder), *plan.recorder_arguments],
        )
        for name in plan.scenario.vehicle_names:
            supervisor.start(name, ["vehicle", *common, "--name", name])
        stop.begun = True
        with announced(OpenRun(plan.run, endpoint, str(plan.folder.resolve()))):
            poll(
                lambda: _is_over(plan, supervisor, recorder, stop, outcome),
                every_s=WATCH_PERIOD_S,
                system=system,
            )
    except BusError as error:  # our own router: no fault of the input
        outcome.fail(str(error))
    except OSError as error:  # the system allows no more processes, memory or open files
        outcome.fail(f"cannot start all processes: {error.strerror}")
    finally:
        if outcome.router_ended:  # let the recorder notice before it is stopped
            system.sleep(NOTICED_S)
        _stop_all(plan, supervisor, outcome)
        outcome.repaired = complete(plan.folder / LOG_NAME)
    if recorder is not None and recorder.exit_code == 0:  # the run was complete before the failure
        outcome.reason, outcome.exit_code = "", 0
    outcome.recorder_killed = recorder is not None and (recorder.exit_code or 0) < 0
    return outcome


def _is_over(
    plan: LaunchPlan,
    supervisor: Supervisor,
    recorder: Child,
    stop: Stop,
    outcome: RunOutcome,
) -> bool:
    vehicles = plan.scenario.vehicle_names
    continues = plan.scenario.continues_without_failed
    if stop.requested:
        outcome.fail(stop.reason, stop.exit_code, is_reported=True)
    for child in supervisor.ended():
        if child is recorder and child.exit_code == 0:
            return True
        if child is recorder and child.exit_code == EXIT_FAILED:
            outcome.fail(RECORDER_FAILED, is_reported=True)
        elif child.name not in vehicles or (child.exit_code != 0 and not continues):
            outcome.router_ended = child.name == ROUTER and not outcome.reason
            outcome.fail(describe(child))
    return bool(outcome.reason)


def _stop_all(plan: LaunchPlan, supervisor: Supervisor, outcome: RunOutcome) -> None:
    """Stop what still runs: the vehicles first, so that the recorder gets their last messages."""
    supervisor.send_reason(RECORDER, outcome.reason)
    names = [child.name for child in supervisor.children]
    supervisor.stop([name for name in names if name in plan.scenario.vehicle_names], grace_s=1.0)
    supervisor.stop([RECORDER], grace_s=2.5)
    supervisor.stop(grace_s=0.2)  # the router, which has nothing to complete
