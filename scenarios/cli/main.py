"""The command line: `convoy COMMAND …`.

Each command imports what it needs when it runs, so that a vehicle process stays small and
`convoy --help` is quick.
"""

import os
import sys
from pathlib import Path
from typing import Any

# One thread per process is plenty for arrays of forty numbers, and the spare ones cost memory.
# NumPy's library reads it when it is loaded, so it comes before everything else.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from scenarios.cli.failure import clear_errors
from scenarios.cli.options import (
    leash_option,
    log_options,
    scenario_options,
    zenoh_from,
    zenoh_options,
)
from scenarios.cli.study import COMMANDS
from scenarios.runs.stop import stop_on_request

EXAMPLES = """\b
Examples:
  convoy run                                  the default scenario, real processes
  convoy run church_lot --rerun spawn         watch it live
  convoy run lossy_lane_change --clock virtual --seed 7
  convoy run my.toml --set links.loss_ratio=0.3
  convoy review runs/…/run.mcap               the same picture from the log
"""


@click.group(epilog=EXAMPLES, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="convoy-emulator")
def cli() -> None:
    """Emulate a convoy: a process per vehicle, poses over Zenoh, logs in MCAP, live in Rerun."""


@cli.command(
    epilog="""\b
Examples:
  convoy run
  convoy run highway --seed 3 --out /tmp/highway
  convoy run lane_change --clock virtual --set links.latency_ms=100
"""
)
@scenario_options
@click.option(
    "--clock",
    type=click.Choice(["wall", "virtual"]),
    default="wall",
    show_default=True,
    help="Real processes in real time, or one process as fast as it goes.",
)
@log_options
def run(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    clock: str,
    out: Path | None,
    rerun: str,
    quiet: bool,
) -> None:
    """Run SCENARIO (a shipped name or a TOML file) and write its log and summary.

    Writes run.mcap and summary.json into runs/<start>-<scenario>/ or the folder given by --out.
    """
    from scenarios.cli.run import run_scenario

    with clear_errors():
        sys.exit(
            run_scenario(scenario, overrides, seed, clock=clock, out=out, rerun=rerun, quiet=quiet)
        )


@cli.command(
    epilog="""\b
Examples:
  convoy router                                  on tcp/127.0.0.1:7447
  convoy router -l tcp/0.0.0.0:7447              for other machines too
"""
)
@zenoh_options
@click.option("--until-empty", is_flag=True, help="End once all who came have left.")
@leash_option
def router(*, until_empty: bool, leash: bool, **flags: Any) -> None:
    """Start the Zenoh router that the vehicles and the recorder meet at."""
    stop = stop_on_request(with_launcher=leash)
    from scenarios.runs.processes.router import route

    with clear_errors():
        sys.exit(route(zenoh_from(flags), stop, until_empty=until_empty))


@cli.command(
    epilog="""\b
Examples:
  convoy vehicle lane_change --name v1 -e tcp/192.0.2.1:7447
  convoy vehicle my.toml --name v3
"""
)
@scenario_options
@click.option("--name", required=True, help="Which vehicle of the scenario to be.")
@zenoh_options
@leash_option
def vehicle(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    name: str,
    leash: bool,
    **flags: Any,
) -> None:
    """Be one vehicle of SCENARIO; starts when the recorder says so."""
    stop = stop_on_request(with_launcher=leash)
    from scenarios.definition.scenario import load_scenario
    from scenarios.runs.processes.vehicle import run_vehicle

    with clear_errors():
        convoy = load_scenario(scenario, overrides, seed)
        sys.exit(run_vehicle(convoy, name, zenoh_from(flags), stop))


@cli.command(
    epilog="""\b
Examples:
  convoy record lane_change -e tcp/192.0.2.1:7447
  convoy record lane_change --out runs/today --rerun serve
"""
)
@scenario_options
@zenoh_options
@log_options
@click.option(
    "--wait",
    "gather_s",
    type=click.FloatRange(min=0.0),
    default=60.0,
    show_default=True,
    metavar="SECONDS",
    help="How long to wait until all vehicles are present.",
)
@leash_option
def record(
    *,
    scenario: str,
    overrides: tuple[str, ...],
    seed: int | None,
    out: Path | None,
    rerun: str,
    quiet: bool,
    gather_s: float,
    leash: bool,
    **flags: Any,
) -> None:
    """Gather the vehicles of SCENARIO, start them together, and write the log of their run."""
    stop = stop_on_request(with_launcher=leash)
    from scenarios.cli.run import record_run
    from scenarios.definition.scenario import load_scenario

    with clear_errors():
        sys.exit(
            record_run(
                load_scenario(scenario, overrides, seed),
                zenoh_from(flags),
                stop,
                out=out,
                rerun=rerun,
                quiet=quiet,
                gather_s=gather_s,
            )
        )


for command in COMMANDS:
    cli.add_command(command)


def main() -> None:
    """Entry point of `convoy`."""
    cli()


if __name__ == "__main__":
    main()
