"""What the commands `run` and `record` do: prepare the folder, run, show, sum up."""

import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from datetime import UTC, datetime
from functools import partial
from importlib import import_module
from pathlib import Path

import click
from rich.console import Console
from rich.text import Text

from scenarios.cli.failure import require
from scenarios.cli.progress import Progress
from scenarios.cli.tables import print_summary
from scenarios.definition.check.report import warnings
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.log_summary import LOG_NAME, SUMMARY_NAME, summary_of, write_summary
from scenarios.results.metrics import Metrics
from scenarios.results.pictures.drawing import open_drawing
from scenarios.results.pictures.layouts import rerun_layout
from scenarios.results.summary import RunSummary
from scenarios.runs.node.sink import BatchingSink
from scenarios.runs.processes.forking import Deed
from scenarios.runs.processes.launcher import SAID_BY_RECORDER, LaunchPlan, launch
from scenarios.runs.processes.membership import (
    RECORDER,
    Fingerprint,
    Membership,
    checked_run_name,
)
from scenarios.runs.processes.recording import RecorderProcess
from scenarios.runs.processes.supervisor import Supervisor
from scenarios.runs.recorder import Listener, Selective
from scenarios.runs.run_folder import claimed, default_folder
from scenarios.runs.stop import EXIT_FAILED, Stop, ignore_signals, stop_on_signals
from scenarios.runs.virtual import VirtualConvoy, run_virtual
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.bus.zenoh_options import RECORDER_DEFAULTS
from transport.log.records import LogError
from transport.picture.option import parse_rerun_option, refuse_foreign_file
from transport.picture.viewer_process import ViewerError, require_display

BePart = Callable[[Scenario, Sequence[str]], Deed]
"""Prepares, of a run of a scenario, what a forked process does as `convoy ARGUMENTS`."""
PARTS = ("scenarios.runs.processes.router", "scenarios.runs.processes.vehicle")
"""Modules of the parts of a run; those of the recorder are imported above."""


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
            return _run_virtual(scenario, folder, rerun, quiet=quiet)
        recorder_flags = ["--rerun", rerun, *(["--quiet"] if quiet else [])]
        plan = LaunchPlan(scenario, again(name, overrides, seed), folder, recorder_flags, common)
        return _run_processes(plan, be_part, quiet=quiet)


def again(name: str, overrides: Sequence[str], seed: int | None) -> list[str]:
    """Arguments that name the same scenario to another process."""
    seeds = [] if seed is None else [f"--seed={seed}"]
    return [name, *(f"--set={text}" for text in overrides), *seeds]


def _run_virtual(scenario: Scenario, folder: Path, rerun: str, *, quiet: bool) -> int:
    stop = stop_on_signals()
    metrics = Metrics.of(scenario)
    with (
        _layout(folder, scenario, rerun, quiet=quiet),
        listeners(scenario, metrics, rerun, run_id=folder.name, quiet=quiet) as watchers,
    ):
        stop.begun = True
        summary = run_virtual(scenario, folder, stop, metrics=metrics, listeners=watchers)
    show(summary, folder, quiet=quiet)
    if quiet and stop.exit_code == EXIT_FAILED:  # a signal was said when it came
        click.echo(summary.reason, err=True)
    return stop.exit_code if summary.reason else 0


def _layout(
    folder: Path, scenario: Scenario, rerun: str, *, quiet: bool
) -> AbstractContextManager[None]:
    """Write Rerun's layout for the log meanwhile, but for who makes many runs: it takes a while."""
    return nullcontext() if quiet and rerun == "off" else rerun_layout(folder, scenario)


def _run_processes(plan: LaunchPlan, be_part: BePart | None, *, quiet: bool) -> int:
    stop = stop_on_signals()
    become = None
    if be_part is not None:
        prepare_parts(plan.scenario)
        become = partial(be_part, plan.scenario)
    outcome = launch(plan, stop, Supervisor(become))
    said = {"", stop.reason, SAID_BY_RECORDER}  # a signal was said when it came
    if outcome.reason not in said:
        console = Console(stderr=True)
        console.print(Text(outcome.reason, "bold red"), highlight=False)
    if outcome.repaired:
        with suppress(LogError):  # killed before the first message
            sum_up(plan.folder, quiet=quiet)
    return outcome.exit_code


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
        metrics = Metrics.of(scenario)
        with (
            _layout(folder, scenario, rerun, quiet=quiet),
            listeners(scenario, metrics, rerun, run_id=folder.name, quiet=quiet) as watchers,
        ):
            stop.begun = True
            recorder = RecorderProcess(
                scenario,
                bus,
                folder,
                stop,
                member,
                metrics=metrics,
                gather_s=gather_s,
                listeners=watchers,
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
    return out or default_folder(scenario.slug, datetime.now(tz=UTC).astimezone())


def refuse_picture(rerun: str, out: Path | None) -> None:
    """Raise an error if the picture cannot go where `--rerun` says, of a run into `out`."""
    option = parse_rerun_option(rerun)
    if option.sink != "off":
        require(f"--rerun {rerun}", "viewer", "rerun")
    if option.sink == "spawn":
        require_display()
    refuse_foreign_file(option)
    own = [(out / name).resolve() for name in (LOG_NAME, SUMMARY_NAME)] if out else []
    if option.sink == "save" and Path(option.target).resolve() in own:
        raise ViewerError(f"--rerun {rerun}: the run writes this file itself; give another one")


@contextmanager
def listeners(
    scenario: Scenario, metrics: Metrics, rerun: str, *, run_id: str, quiet: bool
) -> Iterator[list[Listener]]:
    """Open the viewer and the progress line, which are given each message as it is recorded.

    The progress line shows what `metrics` has gathered.
    """
    with ExitStack() as stack:
        option = parse_rerun_option(rerun)
        view = stack.enter_context(open_drawing(option, scenario, run_id, metrics))
        found: list[Listener] = [] if option.sink == "off" else [view.draw]
        if view.where and not quiet:
            Console(stderr=True).print(
                f"watch it: {view.where}", soft_wrap=True, highlight=False, markup=False
            )
        if not quiet:
            progress = stack.enter_context(Progress(metrics, scenario.duration_s))
            found.append(Selective(progress.kinds, progress.listen))
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
