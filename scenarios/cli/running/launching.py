"""What the command `run` does: prepare the folder, then start the processes, or run virtually.

What only a recorder needs is not imported before the vehicles are forked: they would have a part of
it in their memory.
"""

import secrets
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path

import click

from scenarios.cli.running.destination import refuse_picture, run_folder
from scenarios.definition.check.report import warnings
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.node.sink import BatchingSink
from scenarios.runs.processes.forking import Deed
from scenarios.runs.processes.launcher import SAID_BY_RECORDER, LaunchPlan, launch
from scenarios.runs.processes.membership import Fingerprint, checked_run_name
from scenarios.runs.processes.supervisor import Supervisor
from scenarios.runs.run_folder import claimed
from scenarios.runs.stop import Stop, stop_on_signals
from scenarios.runs.virtual.convoy import VirtualConvoy
from transport.log.records import LogError

BePart = Callable[[Scenario, Sequence[str]], Deed]
"""Prepares, of a run of a scenario, what a forked process does as `convoy ARGUMENTS`."""
PARTS = ("scenarios.runs.processes.router", "scenarios.runs.processes.vehicle")
"""Modules of the parts of a run but for the recorder, which imports its own."""


def run_scenario(
    name: str,
    overrides: Sequence[str],
    seed: int | None,
    *,
    clock: str,
    be_part: BePart | None,
    run_name: str | None,
    out: Path | None,
    rerun: str,
    quiet: bool,
) -> int:
    """`convoy run`: returns the exit code.

    Its processes are forked and do `be_part`; without it each is a program started anew.
    """
    scenario = load_scenario(name, overrides, seed)
    common = checked_run_name(run_name or f"{scenario.name}-{secrets.token_hex(3)}")
    for line in warnings(scenario):
        click.echo(f"warning: {line}", err=True)
    refuse_picture(rerun, out)  # here, in one line, rather than by the recorder
    folder = run_folder(scenario, out)
    with claimed(folder):
        if clock == "virtual":
            from scenarios.cli.running.recording import run_virtually

            return run_virtually(scenario, folder, rerun, quiet=quiet)
        recorder_flags = ["--rerun", rerun, *(["--quiet"] if quiet else [])]
        plan = LaunchPlan(scenario, again(name, overrides, seed), folder, recorder_flags, common)
        return _run_processes(plan, be_part, quiet=quiet)


def again(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    """Arguments that name the same scenario to another process."""
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]


def _run_processes(plan: LaunchPlan, be_part: BePart | None, *, quiet: bool) -> int:
    stop = stop_on_signals()
    become = None
    if be_part is not None:
        prepare_parts(plan.scenario)
        become = partial(be_part, plan.scenario)
    outcome = launch(plan, stop, Supervisor(become), _complete)
    said = {"", stop.reason, SAID_BY_RECORDER}  # a signal was said when it came
    if outcome.reason not in said:
        _say_in_red(outcome.reason)
    if outcome.repaired:
        from scenarios.cli.running.recording import sum_up

        with suppress(LogError):  # killed before the first message
            sum_up(plan.folder, quiet=quiet)
    return outcome.exit_code


def _complete(log: Path) -> bool:
    from transport.log.repair import complete

    return complete(log)


def _say_in_red(line: str) -> None:
    from rich.console import Console
    from rich.text import Text

    Console(stderr=True).print(Text(line, "bold red"), highlight=False)


def prepare_parts(scenario: Scenario) -> None:
    """Do once what every part of a run of `scenario` would do first."""
    for module in PARTS:
        import_module(module)
    Fingerprint.of(scenario)
    for vehicle in scenario.vehicle_names:
        scenario.vehicle(vehicle)
    warm_up()


def warm_up() -> None:
    """Drive three vehicles for a second of virtual time, to no end but to have done it once.

    What the interpreter notes beside the code as it first runs, each vehicle would else write for
    itself, and so have more memory of its own and take longer over its first ticks.
    """
    convoy = VirtualConvoy(load_scenario("lane_change", ("duration_s=1", "convoy.vehicles=3")))
    convoy.build(lambda vehicle: BatchingSink(vehicle, convoy.bus, convoy.clock.now))
    convoy.run(Stop())
