"""What is done where a run is recorded: run or record, with a picture and tables."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path

import click
from rich.console import Console

from scenarios.cli.running.destination import refuse_picture, run_folder
from scenarios.cli.running.progress import Progress
from scenarios.cli.tables import print_summary
from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of, write_summary
from scenarios.results.metrics import Metrics
from scenarios.results.pictures.drawing import open_drawing
from scenarios.results.pictures.layouts import rerun_layout
from scenarios.results.summary import RunSummary
from scenarios.runs.processes.membership import RECORDER, Fingerprint, Membership
from scenarios.runs.processes.recording import RecorderProcess
from scenarios.runs.recorder import Listener, Selective
from scenarios.runs.run_folder import claimed
from scenarios.runs.stop import EXIT_FAILED, Stop, ignore_signals, stop_on_signals
from scenarios.runs.virtual.aside import log_aside
from scenarios.runs.virtual.logged import run_virtual
from transport.bus.zenoh_bus import ZenohOptions, open_bus
from transport.bus.zenoh_options import RECORDER_DEFAULTS
from transport.picture.option import parse_rerun_option


def run_virtually(scenario: Scenario, folder: Path, rerun: str, *, quiet: bool) -> int:
    """`convoy run --clock virtual`: returns the exit code."""
    stop = stop_on_signals()
    metrics = Metrics.of(scenario)
    with (
        log_aside(scenario, folder) as writer,  # before there are threads
        _layout(folder, scenario, rerun, quiet=quiet),
        listeners(scenario, metrics, rerun, run_id=folder.name, quiet=quiet) as watchers,
    ):
        stop.begun = True
        summary = run_virtual(
            scenario, folder, stop, metrics=metrics, listeners=watchers, writer=writer
        )
    show(summary, folder, quiet=quiet)
    if quiet and stop.exit_code == EXIT_FAILED:  # a signal was said when it came
        click.echo(summary.reason, err=True)
    return stop.exit_code if summary.reason else 0


def _layout(
    folder: Path, scenario: Scenario, rerun: str, *, quiet: bool
) -> AbstractContextManager[None]:
    """Write Rerun's layout for the log meanwhile, but for who makes many runs: it takes a while."""
    return nullcontext() if quiet and rerun == "off" else rerun_layout(folder, scenario)


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
