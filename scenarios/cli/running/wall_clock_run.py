"""A run on the wall clock: prepare shared modules and data, then start the processes.

Modules of the recorder are not imported before the vehicles are forked, to save their memory.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path

import click

from scenarios.cli.display_options import DisplayOptions, start_line
from scenarios.cli.error_lines import error_line
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.node.sink import BatchingSink
from scenarios.runs.processes.forking import Task
from scenarios.runs.processes.launcher import LaunchPlan, launch
from scenarios.runs.processes.membership import Fingerprint
from scenarios.runs.processes.supervisor import Supervisor
from scenarios.runs.stop import EXIT_DONE, Stop, stop_on_signals
from scenarios.runs.virtual.virtual_convoy import VirtualConvoy
from transport.clock import SYSTEM_TIME, SystemTime
from transport.log.errors import LogError

PrepareCommand = Callable[[Scenario, Sequence[str]], Task]
"""Prepares `convoy ARGUMENTS` in a forked process, for a run of a scenario."""
PARTS = ("scenarios.runs.processes.router", "scenarios.runs.processes.vehicle_process")
"""Modules of the processes of a run other than the recorder."""


def run_processes(
    plan: LaunchPlan, prepare_command: PrepareCommand, display: DisplayOptions
) -> int:
    """Run on the wall clock; returns the exit code."""
    stop = stop_on_signals()
    prepare_parts(plan.scenario)
    supervisor = Supervisor(partial(prepare_command, plan.scenario))
    return launch_and_report(plan, stop, supervisor, display)


def launch_and_report(
    plan: LaunchPlan,
    stop: Stop,
    supervisor: Supervisor,
    display: DisplayOptions,
    system: SystemTime = SYSTEM_TIME,
) -> int:
    """Launch a run, complete its files and print how it ended; returns the exit code."""
    outcome = launch(
        plan,
        stop,
        supervisor,
        _complete,
        on_router=lambda endpoint: _print_start(plan, endpoint, display),
        system=system,
    )
    if outcome.recorder_killed and not outcome.repaired and _completed(plan.folder, display):
        return EXIT_DONE
    if outcome.reason and not outcome.is_reported:
        from rich.console import Console
        from rich.text import Text

        Console(stderr=True).print(Text(error_line(outcome.reason), "bold red"), highlight=False)
    if outcome.repaired:
        from scenarios.cli.running.recorder_run import summarise_repaired_log

        with suppress(LogError):  # killed before the first message
            summarise_repaired_log(plan.folder, display)
    return outcome.exit_code


def _print_start(plan: LaunchPlan, endpoint: str, display: DisplayOptions) -> None:
    if not display.quiet:
        click.echo(start_line(plan.run, plan.folder, endpoint), err=True)


def _completed(folder: Path, display: DisplayOptions) -> bool:
    """Whether the recorder had completed the log of a completed run before it was killed.

    Writes the summary that is in the log if the recorder could not.
    """
    from scenarios.cli.running.recorder_run import summarise_repaired_log
    from scenarios.results.log_summary import summary_of

    try:
        if summary_of(folder / LOG_NAME).outcome != "completed":
            return False
        if not (folder / SUMMARY_NAME).exists():
            summarise_repaired_log(folder, display)
    except LogError:
        return False
    return True


def _complete(log: Path) -> bool:
    from transport.log.mcap_file import repair_if_truncated

    return repair_if_truncated(log)


def prepare_parts(scenario: Scenario) -> None:
    for module in PARTS:
        import_module(module)
    Fingerprint.of(scenario)
    for vehicle in scenario.vehicle_names:
        scenario.vehicle(vehicle)
    warm_up()


def warm_up() -> None:
    """Drive three vehicles for a second of virtual time, so that the interpreter specializes code.

    Otherwise each vehicle specializes it in its own memory, which slows its first ticks.
    """
    convoy = VirtualConvoy(load_scenario("lane_change", ("duration_s=1", "convoy.vehicles=3")))
    convoy.build(lambda vehicle: BatchingSink(vehicle, convoy.bus, convoy.clock.now))
    convoy.run()
