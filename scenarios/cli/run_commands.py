"""Commands that run a convoy, or one of its processes."""

import signal
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from scenarios.cli.common_options import (
    DisplayOptions,
    Tables,
    clock_option,
    log_options,
    output_option,
    parent_watch_option,
    partial_option,
    print_or_write,
    run_option,
    scenario_options,
    setting_options,
    time_option,
    zenoh_from,
    zenoh_options,
)
from scenarios.cli.output import (
    clear_errors,
    keep_output_going,
    print_error,
    unwritable_output_reported,
    warn_of_log,
)
from scenarios.runs.stop import STOP_SIGNALS, end_on_signals, ignore_hangup, stop_on_request

if TYPE_CHECKING:
    from scenarios.definition.scenario import Scenario
    from transport.bus.zenoh_options import ZenohOptions


@click.command(
    epilog="""\b
Examples:
  convoy run
  convoy run highway --seed 3 --out /tmp/highway
  convoy run lane_change --clock virtual --set links.latency_ms=100
  convoy run drive.gpx --clock virtual      a recorded drive of your own
"""
)
@scenario_options
@clock_option
@run_option
@log_options
def run(scenario: str, *, overrides: tuple[str, ...], seed: int | None, **options: Any) -> None:
    """Run a scenario.

    SCENARIO is a shipped name (see `convoy list`), a TOML file, or a recorded drive, such as a GPX
    file. Writes the log run.mcap and the summary summary.json into a new folder.
    """
    from scenarios.cli.launching import RunOptions, run_scenario

    ignore_hangup()
    with clear_errors():
        sys.exit(run_scenario(scenario, overrides, seed, RunOptions(**options)))


@click.command(
    epilog="""\b
Examples:
  convoy router                                  on tcp/127.0.0.1:7447
  convoy router -l tcp/0.0.0.0:7447              for all machines
"""
)
@zenoh_options
@click.option("--until-empty", is_flag=True, help="End when the last client has disconnected.")
@parent_watch_option
def router(*, until_empty: bool, launched: bool, **flags: Any) -> None:
    """Start a Zenoh router.

    Vehicles and recorder of a convoy connect to it. By default it listens on tcp/127.0.0.1:7447.
    """
    stop = stop_on_request(with_launcher=launched)
    from scenarios.runs.node.process_probe import name_process
    from scenarios.runs.processes.supervisor import route

    name_process("router")

    with clear_errors():
        sys.exit(route(zenoh_from(flags), stop, until_empty=until_empty))


@click.command(
    epilog="""\b
Examples:
  convoy vehicle lane_change --name v1 -e tcp/192.0.2.1:7447
  convoy vehicle my.toml --name v3 --run second
"""
)
@scenario_options
@click.option(
    "--name",
    required=True,
    metavar="NAME",
    help="Name of the vehicle in the scenario.",
)
@run_option
@zenoh_options
@time_option("--wait", default=600.0, help_text="Longest wait for the start. Default: 10min.")
@click.option("--quiet", is_flag=True, help="Print errors and warnings only.")
@parent_watch_option
def vehicle(*, name: str, wait_s: float, quiet: bool, launched: bool, **of_convoy: Any) -> None:
    """Run one vehicle of a scenario.

    SCENARIO is a shipped name, a TOML file, or a recorded drive. The vehicle starts when the
    recorder announces the start of the run.
    """
    stop = stop_on_request(with_launcher=launched)
    from scenarios.runs.processes.restart import ProcessHandover, RestartRequestedError
    from scenarios.runs.processes.vehicle_process import run_vehicle

    with clear_errors():
        convoy, options = _part_of_convoy(name, **of_convoy)
        before: ProcessHandover | None = None
        while True:
            try:
                exit_code = run_vehicle(
                    convoy,
                    name,
                    options,
                    stop,
                    report=(lambda _: None) if quiet or launched else partial(click.echo, err=True),
                    report_error=print_error,
                    launched=launched,
                    wait_s=wait_s,
                    before=before,
                )
            except RestartRequestedError as request:
                before = request.handover
            else:
                sys.exit(exit_code)


@click.command(
    epilog="""\b
Examples:
  convoy record lane_change -e tcp/192.0.2.1:7447
  convoy record lane_change --out runs/today --serve
"""
)
@scenario_options
@run_option
@log_options
@zenoh_options
@time_option("--wait", default=60.0, help_text="Longest wait for all vehicles. Default: 60s.")
@click.option("--rerun", hidden=True, help="Destination of the picture, from `convoy run`.")
@parent_watch_option
def record(
    *,
    out: Path | None,
    rerun: str,
    quiet: bool,
    tables: Tables,
    wait_s: float,
    launched: bool,
    **of_convoy: Any,
) -> None:
    """Start the run of a convoy and record it.

    Waits for all vehicles of SCENARIO, starts them together, and writes the log and the summary of
    the run.
    """
    stop = stop_on_request(with_launcher=launched)
    from scenarios.cli.recorder_run import record_run

    with clear_errors():
        convoy, options = _part_of_convoy("recorder", **of_convoy)
        display = DisplayOptions(rerun=rerun, quiet=quiet, tables=tables)
        sys.exit(
            record_run(
                convoy, options, stop, out=out, display=display, gather_s=wait_s, launched=launched
            )
        )


def _part_of_convoy(
    process: str,
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    run_name: str | None,
    **flags: Any,
) -> "tuple[Scenario, ZenohOptions]":
    """Load the scenario of a convoy in a process with this name, and read its Zenoh flags."""
    from scenarios.definition.scenario import load_scenario
    from scenarios.runs.node.process_probe import name_process
    from scenarios.runs.processes.membership import checked_run_name

    name_process(process)
    ignore_hangup()
    convoy = load_scenario(scenario, overrides, seed)
    return convoy, zenoh_from(flags, checked_run_name(run_name or convoy.name))


def run_part(arguments: Sequence[str]) -> None:
    """Run `convoy ARGUMENTS` as a part of a run, in a process started with blocked signals."""
    end_on_signals(report=False)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
    keep_output_going()
    part, *flags = arguments
    command = {"router": router, "record": record, "vehicle": vehicle}[part]
    with unwritable_output_reported():
        command.main(flags, prog_name=f"convoy {part}")


# ---- `convoy replay`


@click.command(
    epilog="""\b
Examples:
  convoy replay runs/first --vehicles v1,v2                   v3 and v4 are live
  convoy replay runs/first --vehicles v1 --clock virtual --set control.controller=stanley
  convoy replay runs/first --vehicles v1 --set convoy.vehicles=6

\b
On several machines, each vehicle and the recorder with the same file:
  convoy replay runs/first --vehicles v1,v2 -o replay.toml
  convoy vehicle replay.toml --name v1 -e tcp/192.0.2.1:7447
  convoy record replay.toml -e tcp/192.0.2.1:7447
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--vehicles",
    required=True,
    metavar="NAMES",
    help="Vehicles that send their recorded messages, such as v1,v2. The others are simulated.",
)
@setting_options
@clock_option
@run_option
@log_options
@output_option("Write the scenario of the replay into this new file instead of running it.")
@partial_option
def replay(
    log: Path,
    *,
    vehicles: str,
    overrides: tuple[str, ...],
    seed: int | None,
    output: Path | None,
    partial: bool,
    **options: Any,
) -> None:
    """Drive live vehicles behind recorded ones.

    LOG is a run.mcap or its folder. Repeats its run, with the changes made by hand: the named
    vehicles send their recorded poses at the recorded times and under their names, and the others
    drive live. Links drop and delay messages as in any run. The new log also holds the true poses
    of the replayed vehicles. With the settings and the seed of LOG, a virtual run gives the
    recorded followers again, bit for bit.
    """
    from scenarios.cli.launching import RunOptions, replay_run
    from scenarios.results.log_summary import log_in
    from scenarios.runs.replayed import replayed_session

    ignore_hangup()
    with clear_errors():
        scenario = replayed_session(
            log_in(log),
            [name.strip() for name in vehicles.split(",") if name.strip()],
            overrides,
            seed,
            warn=warn_of_log,
            partial=partial,
        )
        if output is not None:
            print_or_write(scenario.text, output)
            return
        sys.exit(replay_run(scenario, RunOptions(**options)))
