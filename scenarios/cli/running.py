"""What the commands `run` and `record` do: prepare the folder, run, show, sum up."""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import click
from rich.console import Console

from scenarios.cli.progress import Progress
from scenarios.cli.tables import print_summary
from scenarios.definition.check.report import warnings
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.log_summary import LOG_NAME, SUMMARY_NAME, summary_of, write_summary
from scenarios.results.review import open_view
from scenarios.results.summary import RunSummary
from scenarios.runs.processes.launcher import LaunchPlan, launch
from scenarios.runs.processes.membership import (
    RECORDER,
    Fingerprint,
    Membership,
    checked_run_name,
)
from scenarios.runs.processes.recording import RecorderProcess
from scenarios.runs.processes.supervisor import Supervisor
from scenarios.runs.recorder import Listener
from scenarios.runs.run_folder import claimed, default_folder
from scenarios.runs.stop import EXIT_FAILED, Stop, ignore_signals, stop_on_signals
from scenarios.runs.virtual import run_virtual
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.bus.zenoh_options import RECORDER_DEFAULTS
from transport.log.records import LogError
from transport.picture.option import parse_rerun_option, refuse_foreign_file
from transport.picture.viewer_process import ViewerError, require_display


def run_scenario(
    name: str,
    overrides: Sequence[str],
    seed: int | None,
    *,
    clock: str,
    run_name: str | None,
    out: Path | None,
    rerun: str,
    quiet: bool,
) -> int:
    """`convoy run`: returns the exit code."""
    scenario = load_scenario(name, overrides, seed)
    common = checked_run_name(run_name or f"{scenario.name}-{secrets.token_hex(3)}")
    for line in warnings(scenario):
        click.echo(f"warning: {line}", err=True)
    refuse_picture(rerun, out)  # here, in one line, rather than by the recorder
    folder = run_folder(scenario, out)
    with claimed(folder):
        plan = LaunchPlan(scenario, again(name, overrides, seed), folder, [], common)
        return _run_in(plan, clock, rerun, quiet=quiet)


def again(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    """Arguments that name the same scenario to another process."""
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]


def _run_in(plan: LaunchPlan, clock: str, rerun: str, *, quiet: bool) -> int:
    stop = stop_on_signals()
    scenario, folder = plan.scenario, plan.folder
    if clock == "virtual":
        with listeners(scenario, rerun, run_id=folder.name, quiet=quiet) as watchers:
            stop.begun = True
            summary = run_virtual(scenario, folder, stop, listeners=watchers)
        show(summary, folder, quiet=quiet)
        if quiet and stop.exit_code == EXIT_FAILED:  # a signal was said when it came
            click.echo(summary.reason, err=True)
        return stop.exit_code if summary.reason else 0
    recorder_flags = ["--rerun", rerun, *(["--quiet"] if quiet else [])]
    outcome = launch(replace(plan, recorder_arguments=recorder_flags), stop, Supervisor())
    if outcome.reason and outcome.reason != stop.reason:  # a signal was said when it came
        console = Console(stderr=True)
        console.print(f"[bold red]{outcome.reason}[/]", highlight=False)
    if outcome.repaired:
        with suppress(LogError):  # killed before the first message
            sum_up(folder, quiet=quiet)
    return outcome.exit_code


def record_run(
    scenario: Scenario,
    options: ZenohOptions,
    stop: Stop,
    *,
    out: Path | None,
    rerun: str,
    quiet: bool,
    gather_s: float,
    launched: bool,
) -> int:
    """`convoy record`: returns the exit code.

    `launched` says that `convoy run` has started it, which holds the folder.
    """
    refuse_picture(rerun, out)
    folder = run_folder(scenario, out)
    with (
        nullcontext() if launched else claimed(folder),
        open_bus(options, RECORDER_DEFAULTS) as bus,
    ):
        member = Membership(bus, options.run, RECORDER, "recorder", Fingerprint.of(scenario))
        member.join()
        with listeners(scenario, rerun, run_id=folder.name, quiet=quiet) as watchers:
            stop.begun = True
            recorder = RecorderProcess(
                scenario, bus, folder, stop, member, gather_s=gather_s, listeners=watchers
            )
            summary = recorder.record_until_over()
        show(summary, folder, quiet=quiet)
        # Last of all: on this the vehicles end, and the end of one container may stop all others.
        # A signal that comes when all is done changes nothing any more, to the very end.
        ignore_signals()
        recorder.announce_completion()
    if quiet and summary.reason not in {"", stop.reason}:
        click.echo(summary.reason, err=True)
    return (stop.exit_code or EXIT_FAILED) if summary.reason else 0


def run_folder(scenario: Scenario, out: Path | None) -> Path:
    """Folder of a new run, by default a new one."""
    return out or default_folder(scenario.name, datetime.now(tz=UTC).astimezone())


def refuse_picture(rerun: str, out: Path | None) -> None:
    """Raise ViewerError if the picture cannot go where `--rerun` says, of a run into `out`."""
    option = parse_rerun_option(rerun)
    if option.sink == "spawn":
        require_display()
    refuse_foreign_file(option)
    own = [(out / name).resolve() for name in (LOG_NAME, SUMMARY_NAME)] if out else []
    if option.sink == "save" and Path(option.target).resolve() in own:
        raise ViewerError(f"--rerun {rerun}: the run writes this file itself; give another one")


@contextmanager
def listeners(
    scenario: Scenario, rerun: str, *, run_id: str, quiet: bool
) -> Iterator[list[Listener]]:
    """Open the viewer and the progress line, which are given each message as it is recorded."""
    with ExitStack() as stack:
        view = stack.enter_context(open_view(parse_rerun_option(rerun), scenario, run_id))
        found: list[Listener] = [view.draw]
        if view.where and not quiet:
            Console(stderr=True).print(f"watch it: {view.where}", soft_wrap=True, highlight=False)
        if not quiet:
            progress = Progress.of(scenario)
            found.append(stack.enter_context(progress).listen)
        yield found


def sum_up(folder: Path, *, quiet: bool) -> None:
    """Write and show the summary of a run whose recorder could not; raises LogError."""
    summary = summary_of(folder / LOG_NAME)
    try:
        write_summary(folder, summary)
    finally:
        show(summary, folder, quiet=quiet)


def show(summary: RunSummary, folder: Path, *, quiet: bool) -> None:
    """Print the tables of a run."""
    if not quiet:
        print_summary(summary, folder / LOG_NAME, Console())
