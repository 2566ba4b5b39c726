"""`convoy record`, with a picture and tables."""

from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path

from scenarios.cli.common_options import DisplayOptions
from scenarios.cli.display import displays, print_start, refuse_picture, show
from scenarios.cli.output import print_error
from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of, write_summary
from scenarios.runs.end_confirmation import random_run_id
from scenarios.runs.node.process_probe import THIS_MACHINE, Machine
from scenarios.runs.processes.membership import RECORDER, Fingerprint, Membership
from scenarios.runs.processes.recorder_process import RecorderProcess
from scenarios.runs.run_folder import claimed, folder_of
from scenarios.runs.stop import EXIT_FAILED, Stop, ignore_signals
from transport.bus.zenoh_bus import ZenohOptions


def record_run(
    scenario: Scenario,
    options: ZenohOptions,
    stop: Stop,
    *,
    out: Path | None,
    display: DisplayOptions,
    gather_s: float,
    launched: bool,
    machine: Machine = THIS_MACHINE,
    make_run_id: Callable[[], str] = random_run_id,
) -> int:
    """Gather and record the vehicles of a run; returns the exit code.

    `launched` by `convoy run`, which holds the folder.
    """
    refuse_picture(display.rerun, out)
    folder = folder_of(scenario, out)
    with (
        nullcontext() if launched else claimed(folder, fresh=out is None),
        machine.open_bus(options) as bus,
    ):
        fingerprint = Fingerprint.of(scenario)
        member = Membership(bus, options.run, RECORDER, make_run_id(), fingerprint)
        member.join(sleep=machine.time.sleep)
        if not launched:
            print_start(options.run, folder, display, ", ".join(options.connect))
        lost = list[str]()
        with displays(scenario, display, folder, lost) as (receivers, watchers):
            stop.begun = True
            recorder = RecorderProcess(
                scenario,
                bus,
                folder,
                stop,
                member,
                gather_s=gather_s,
                observers=receivers,
                watchers=watchers,
                system=machine.time,
            )
            summary = recorder.record_until_over()
        show(summary, folder, display)
        # Last of all: the vehicles wait for it, and the end of one container may stop all others.
        # Signals are ignored from here, as the result is complete.
        ignore_signals(stop)
        if remaining := recorder.announce_completion():
            print_error(f"the run is completed, but {', '.join(remaining)} did not confirm the end")
    if display.quiet and summary.reason not in {"", stop.reason}:
        print_error(summary.reason)
    if summary.reason:
        return stop.exit_code or EXIT_FAILED
    return EXIT_FAILED if lost else 0


def summarise_repaired_log(folder: Path, display: DisplayOptions) -> None:
    """Write and show the summary of a run whose recorder could not; raises LogError."""
    summary = summary_of(folder / LOG_NAME)
    try:
        write_summary(folder, summary)
    finally:
        show(summary, folder, display)
