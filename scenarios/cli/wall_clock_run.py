"""A run on the wall clock: start its processes, complete its files."""

from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import click

from scenarios.cli.common_options import DisplayOptions, start_line
from scenarios.cli.output import error_line
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.processes.fork_server import stop_fork_server
from scenarios.runs.processes.supervisor import LaunchPlan, Supervisor, launch
from scenarios.runs.stop import EXIT_DONE, Stop, stop_on_signals
from transport.clock import SYSTEM_TIME, SystemTime
from transport.log.errors import LogError

COMMANDS = "scenarios.cli.run_commands"
"""Module of the commands, which import this one."""


def run_part(arguments: Sequence[str]) -> None:
    """Run `convoy ARGUMENTS` as a part of a run, in a new process."""
    import_module(COMMANDS).run_part(arguments)


def run_processes(plan: LaunchPlan, display: DisplayOptions) -> int:
    """Run on the wall clock; returns the exit code."""
    try:
        return launch_and_report(
            plan, stop_on_signals(), Supervisor(run_part, (COMMANDS,)), display
        )
    finally:
        stop_fork_server()


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
        from scenarios.cli.recorder_run import summarise_repaired_log

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
    from scenarios.cli.recorder_run import summarise_repaired_log
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
