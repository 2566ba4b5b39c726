"""What the commands `run` and `record` do: prepare the folder, run, show, sum up."""

import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

import click
from rich.console import Console

from scenarios.cli.progress import Progress
from scenarios.cli.tables import print_summary
from scenarios.definition.check.report import warnings
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.log_summary import LOG_NAME, SUMMARY_NAME, summary_of
from scenarios.results.review import open_view
from scenarios.results.summary import RunSummary, to_json
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
from scenarios.runs.stop import EXIT_FAILED, Stop, stop_on_signals
from scenarios.runs.virtual import run_virtual
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.bus.zenoh_options import RECORDER_DEFAULTS
from transport.log.records import LogError
from transport.picture.option import parse_rerun_option


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
    parse_rerun_option(rerun)  # refused here, in one line, rather than by the recorder
    folder = run_folder(scenario, out)
    stop = stop_on_signals()
    if clock == "virtual":
        with listeners(scenario, rerun, run_id=folder.name, quiet=quiet) as watchers:
            summary = run_virtual(scenario, folder, stop, listeners=watchers)
        show(summary, folder, quiet=quiet)
        if quiet and summary.reason and not stop.asked:
            click.echo(summary.reason, err=True)
        return (stop.exit_code or EXIT_FAILED) if summary.reason else 0
    again = [name, *(f"--set={text}" for text in overrides)]
    if seed is not None:
        again.append(f"--seed={seed}")
    recorder_flags = ["--rerun", rerun, *(["--quiet"] if quiet else [])]
    plan = LaunchPlan(scenario, again, folder, recorder_flags, common)
    outcome = launch(plan, stop, Supervisor())
    if outcome.reason:
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
) -> int:
    """`convoy record`: returns the exit code."""
    stop.begun = True
    folder = run_folder(scenario, out)
    with open_bus(options, RECORDER_DEFAULTS) as bus:
        member = Membership(bus, options.run, RECORDER, "recorder", Fingerprint.of(scenario))
        member.join()
        with listeners(scenario, rerun, run_id=folder.name, quiet=quiet) as watchers:
            recorder = RecorderProcess(
                scenario, bus, folder, stop, member, gather_s=gather_s, listeners=watchers
            )
            summary = recorder.record_until_over()
        show(summary, folder, quiet=quiet)
        # Last of all: on this the vehicles end, and the end of one container may stop all others.
        recorder.announce_completion()
    if quiet and summary.reason and not stop.asked:
        click.echo(summary.reason, err=True)
    # A signal that comes when all is done changes nothing any more.
    return (stop.exit_code or EXIT_FAILED) if summary.reason else 0


def run_folder(scenario: Scenario, out: Path | None) -> Path:
    """Folder of a new run; a log that is there already is never overwritten."""
    started = datetime.now(tz=UTC).astimezone().strftime("%Y%m%d-%H%M%S")
    folder = out or Path("runs") / f"{started}-{scenario.name}"
    if (folder / LOG_NAME).exists():
        raise ScenarioError([f"{folder / LOG_NAME}: exists; give another folder by --out"])
    return folder


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
            progress = Progress(scenario.vehicle_names, scenario.duration_s)
            found.append(stack.enter_context(progress).listen)
        yield found


def sum_up(folder: Path, *, quiet: bool) -> None:
    """Write and show the summary of a run whose recorder could not; raises LogError."""
    summary = summary_of(folder / LOG_NAME)
    (folder / SUMMARY_NAME).write_text(to_json(summary), encoding="utf-8")
    show(summary, folder, quiet=quiet)


def show(summary: RunSummary, folder: Path, *, quiet: bool) -> None:
    """Print the tables of a run."""
    if not quiet:
        print_summary(summary, folder / LOG_NAME, Console())
