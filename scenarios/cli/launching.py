"""`convoy run`: prepare the folder, then start the processes, or run virtually."""

import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click

from scenarios.cli.common_options import DisplayOptions
from scenarios.cli.display import displays, print_start, refuse_picture, show
from scenarios.cli.output import print_error
from scenarios.definition.check.findings import warnings
from scenarios.definition.check.unusual import unusual_settings
from scenarios.definition.library import is_run
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.processes.membership import checked_run_name
from scenarios.runs.run_folder import claimed, folder_of
from scenarios.runs.stop import EXIT_FAILED, Stop, stop_on_signals
from scenarios.runs.virtual import run_virtual

# ---- `convoy run --clock virtual`, with a picture and tables


def run_virtually(
    scenario: Scenario,
    folder: Path,
    stop: Stop,
    run: str,
    options: DisplayOptions,
) -> int:
    print_start(run, folder, options)
    lost = list[str]()
    with displays(scenario, options, folder, lost) as (receivers, watchers):
        stop.begun = True
        summary = run_virtual(scenario, folder, stop, watchers=watchers, observers=receivers)
    show(summary, folder, options)
    if options.quiet and stop.exit_code == EXIT_FAILED:  # signals are reported when they arrive
        print_error(summary.reason)
    if summary.reason:
        return stop.exit_code
    return EXIT_FAILED if lost else 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(DisplayOptions):
    """Options of a run, as the command line has them."""

    clock: str
    run_name: str | None = None
    out: Path | None = None


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
    on_wall_clock, out = options.clock == "wall", options.out
    common = checked_run_name(options.run_name or f"{scenario.name}-{secrets.token_hex(3)}")
    unusual = unusual_settings(scenario, wall_clock=on_wall_clock)
    for line in (*unusual, *warnings(scenario)):
        click.echo(f"warning: {line}", err=True)
    for name in scenario.vehicle_names:
        scenario.vehicle(name).controller()  # refuse a user's class that cannot be built
    refuse_picture(options.rerun, out)  # in one line here, before the recorder starts
    folder = folder_of(scenario, out)
    with claimed(folder, fresh=out is None):
        if not on_wall_clock:
            return run_virtually(scenario, folder, stop_on_signals(), common, options)
        from scenarios.cli.wall_clock_run import run_processes
        from scenarios.runs.processes.supervisor import LaunchPlan

        plan = LaunchPlan(scenario, arguments, folder, options.arguments, common)
        return run_processes(plan, options)


def scenario_arguments(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]
