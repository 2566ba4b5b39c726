"""`convoy run`: prepare the folder, then start the processes, or run virtually."""

import secrets
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from scenarios.cli.common_options import DisplayOptions, start_line
from scenarios.cli.display import observers, print_start, refuse_picture, show
from scenarios.cli.output import error_line, print_error
from scenarios.definition.check.confirmation import confirmed_lines
from scenarios.definition.check.findings import warnings
from scenarios.definition.library import is_run
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.results.metrics import Metrics
from scenarios.runs.processes.fork_server import stop_fork_server
from scenarios.runs.processes.membership import checked_run_name
from scenarios.runs.processes.supervisor import LaunchPlan, Supervisor, launch
from scenarios.runs.run_folder import claimed, folder_of
from scenarios.runs.stop import EXIT_DONE, EXIT_FAILED, Stop, stop_on_signals
from scenarios.runs.virtual import run_virtual
from transport.clock import SYSTEM_TIME, SystemTime
from transport.log.errors import LogError

# ---- `convoy run --clock virtual`, with a picture and tables


def run_virtually(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    run: str,
    options: DisplayOptions,
) -> int:
    print_start(run, folder, options)
    metrics, lost = Metrics.of(scenario), list[str]()
    with observers(scenario, metrics, options, folder, lost) as watchers:
        stop.begun = True
        summary = run_virtual(scenario, folder, stop, metrics=metrics, observers=watchers)
    show(summary, folder, options)
    if options.quiet and stop.exit_code == EXIT_FAILED:  # signals are reported when they arrive
        print_error(summary.reason)
    if summary.reason:
        return stop.exit_code
    return EXIT_FAILED if lost else 0


# ---- A run on the wall clock: start its processes, complete its files


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


# ---- Launching


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    clock: str
    display: DisplayOptions
    run_name: str | None = None
    out: Path | None = None
    confirmed: bool = False


def run_scenario(name: str, overrides: Sequence[str], seed: int | None, options: RunOptions) -> int:
    """Run a scenario; returns the exit code."""
    scenario = load_scenario(name, overrides, seed)
    if is_run(name):
        click.echo(
            f"the recorded lead of {name} leads again, in a new scenario with default settings; "
            "`convoy scenario-from` repeats the run, `convoy replay` its vehicles",
            err=True,
        )
    return _run_loaded(scenario, scenario_arguments(name, overrides, seed), options)


def replay_run(scenario: Scenario, options: RunOptions) -> int:
    """Run a scenario that is in no file; returns the exit code.

    The processes of the run read it from a file, which is deleted at the end.
    """
    with TemporaryDirectory(prefix="convoy-") as folder:
        file = Path(folder, f"{scenario.name}.toml")
        file.write_text(scenario.text, encoding="utf-8")
        return _run_loaded(scenario, [str(file)], options)


def _run_loaded(scenario: Scenario, arguments: Sequence[str], options: RunOptions) -> int:
    """Run `scenario`, which the command-line `arguments` select; returns the exit code."""
    on_wall_clock, display, out = options.clock == "wall", options.display, options.out
    common = checked_run_name(options.run_name or f"{scenario.name}-{secrets.token_hex(3)}")
    unusual = confirmed_lines(scenario, wall_clock=on_wall_clock, confirmed=options.confirmed)
    for line in (*unusual, *warnings(scenario)):
        click.echo(f"warning: {line}", err=True)
    refuse_picture(display.rerun, out)  # in one line here, before the recorder starts
    folder = folder_of(scenario, out)
    with claimed(folder, fresh=out is None):
        if not on_wall_clock:
            stop = stop_on_signals()

            return run_virtually(scenario, folder, stop, common, display)
        from scenarios.runs.processes.supervisor import LaunchPlan

        plan = LaunchPlan(scenario, arguments, folder, display.arguments, common)
        return run_processes(plan, display)


def scenario_arguments(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]
