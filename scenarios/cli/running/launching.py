"""`convoy run`: prepare the folder, then start the processes, or run virtually."""

import secrets
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import click

from scenarios.cli.display_options import DisplayOptions
from scenarios.cli.running.destination import refuse_picture
from scenarios.definition.check.confirmation import confirmed_lines
from scenarios.definition.check.findings import warnings
from scenarios.definition.library import is_run
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.processes.membership import checked_run_name
from scenarios.runs.run_folder import claimed, folder_of
from scenarios.runs.stop import stop_on_signals

if TYPE_CHECKING:  # virtual runs need none
    from scenarios.cli.running.wall_clock_run import PrepareCommand


def run_scenario(
    name: str,
    overrides: Sequence[str],
    seed: int | None,
    *,
    clock: str,
    prepare_command: "PrepareCommand | None",
    run_name: str | None,
    out: Path | None,
    display: DisplayOptions,
    confirmed: bool,
) -> int:
    """Run a scenario; returns the exit code.

    Processes are forked and do `prepare_command`; without it each is a new program.
    """
    scenario = load_scenario(name, overrides, seed)
    if is_run(name):
        click.echo(
            f"the recorded lead of {name} leads again, in a new scenario with default settings; "
            "`convoy scenario-from` repeats the run, `convoy replay` its vehicles",
            err=True,
        )
    return run_loaded(
        scenario,
        scenario_arguments(name, overrides, seed),
        clock=clock,
        prepare_command=prepare_command,
        run_name=run_name,
        out=out,
        display=display,
        confirmed=confirmed,
    )


def replay_run(
    scenario: Scenario,
    *,
    clock: str,
    prepare_command: "PrepareCommand",
    run_name: str | None,
    out: Path | None,
    display: DisplayOptions,
    confirmed: bool,
) -> int:
    """Run a scenario that is in no file; returns the exit code.

    A process that restarts reads it from a file, which is deleted at the end.
    """
    with TemporaryDirectory(prefix="convoy-") as folder:
        file = Path(folder, f"{scenario.name}.toml")
        file.write_text(scenario.text, encoding="utf-8")
        return run_loaded(
            scenario,
            [str(file)],
            clock=clock,
            prepare_command=prepare_command,
            run_name=run_name,
            out=out,
            display=display,
            confirmed=confirmed,
        )


def run_loaded(
    scenario: Scenario,
    arguments: Sequence[str],
    *,
    clock: str,
    prepare_command: "PrepareCommand | None",
    run_name: str | None,
    out: Path | None,
    display: DisplayOptions,
    confirmed: bool,
) -> int:
    """Run `scenario`, which the command-line `arguments` select; returns the exit code."""
    common = checked_run_name(run_name or f"{scenario.name}-{secrets.token_hex(3)}")
    unusual = confirmed_lines(scenario, wall_clock=clock == "wall", confirmed=confirmed)
    for line in (*unusual, *warnings(scenario)):
        click.echo(f"warning: {line}", err=True)
    refuse_picture(display.rerun, out)  # in one line here, before the recorder starts
    folder = folder_of(scenario, out)
    with claimed(folder, fresh=out is None):
        if clock == "virtual":
            stop = stop_on_signals()
            from scenarios.cli.running.virtual_run import run_virtually

            return run_virtually(scenario, folder, stop, common, display)
        from scenarios.cli.running.wall_clock_run import run_processes
        from scenarios.runs.processes.launcher import LaunchPlan

        plan = LaunchPlan(scenario, arguments, folder, display.arguments, common)
        return run_processes(plan, prepare_command, display)


def scenario_arguments(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]
