"""The command line: `convoy COMMAND …`.

Each command imports what it needs when it runs, so that a vehicle process stays small and
`convoy --help` is quick.
"""

import os
import sys
import time
from pathlib import Path
from typing import Any

# One thread per process is plenty for arrays of forty numbers, and the spare ones cost memory.
# NumPy's library reads it when it is loaded, so it comes before everything else.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from scenarios.failure import clear_errors
from scenarios.options import leash_option, log_options, scenario_options, zenoh_from, zenoh_options

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
    from scenarios.running import run_scenario

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
    from scenarios.router import route

    with clear_errors():
        sys.exit(
            route(
                zenoh_from(flags),
                until_empty=until_empty,
                leash=leash,
            )
        )


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
    from scenarios.vehicle import be_vehicle

    with clear_errors():
        sys.exit(
            be_vehicle(scenario, overrides, seed, name=name, options=zenoh_from(flags), leash=leash)
        )


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
    from scenarios.leash import hold_leash, stop_on_signals
    from scenarios.running import record_run
    from scenarios.scenario import load_scenario

    with clear_errors():
        stop = stop_on_signals()
        if leash:
            hold_leash(stop)
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


@cli.command(name="list", epilog="Example: convoy list")
def list_scenarios() -> None:
    """List the scenarios that ship."""
    from scenarios.scenario import library, load_scenario

    for name in library():
        click.echo(f"{name:20} {load_scenario(name).tables.description}")


@cli.command(
    epilog="""\b
Examples:
  convoy check church_lot
  convoy check my.toml --set speed.set_mps=25 --json
"""
)
@scenario_options
@click.option("--json", "as_json", is_flag=True, help="The figures as JSON.")
def check(*, scenario: str, overrides: tuple[str, ...], seed: int | None, as_json: bool) -> None:
    """Say what SCENARIO asks for, and warn of what may surprise; run nothing."""
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.certificate import certificate_warnings
    from scenarios.check import report_of
    from scenarios.report import check_table
    from scenarios.scenario import load_scenario

    with clear_errors():
        loaded = load_scenario(scenario, overrides, seed)
        report = report_of(loaded)
        warnings = (*report.warnings, *certificate_warnings(loaded))
        if as_json:
            click.echo(json.dumps(asdict(report) | {"warnings": warnings}, indent=2))
            return
        Console().print(check_table(report))
        for line in warnings:
            click.echo(f"warning: {line}")


@cli.command(
    epilog="""\b
Examples:
  convoy gains                                   the paper's gains on the paper's car
  convoy gains --gains 0.1 0.9 0.1 --speed 15 --speed 30 --out gains-new
"""
)
@click.option(
    "--gains",
    type=float,
    nargs=3,
    default=(0.06, 0.96, 0.08),
    show_default=True,
    metavar="KE KTHETA KOMEGA",
    help="Feedback gains: rad/m, rad/rad, s.",
)
@click.option(
    "--speed", "speeds", type=click.FloatRange(min=1.0), multiple=True, help="Speeds in m/s."
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("gains"),
    show_default=True,
    help="Folder for gains.json and the pictures.",
)
def gains(*, gains: tuple[float, float, float], speeds: tuple[float, ...], out: Path) -> None:
    """Stabilising gain sets, margins, varying speed, loadings and propagation, with pictures."""
    from rich.console import Console

    from scenarios.gains_report import DEFAULT_SPEEDS, gains_report
    from scenarios.report import gains_table
    from vehicles.parameters import LINCOLN_MKZ
    from vehicles.steering import Gains

    with clear_errors():
        report = gains_report(LINCOLN_MKZ, Gains(*gains), speeds or DEFAULT_SPEEDS, out_dir=out)
        Console().print(gains_table(report))
        click.echo(f"written: {out / 'gains.json'} and {len(report['pictures'])} pictures")


@cli.command(epilog="Example: convoy new > my.toml")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def new(file: Path | None) -> None:
    """Write a commented scenario with every option to FILE, or to standard output."""
    from scenarios.scenario import template

    with clear_errors():
        if file is None:
            click.echo(template(), nl=False)
        else:
            with file.open("x", encoding="utf-8") as target:
                target.write(template())
            click.echo(f"wrote {file}; try it: convoy run {file}")


@cli.command(
    epilog="""\b
Examples:
  convoy review runs/20260101-120000-lane_change/run.mcap
  convoy review run.mcap --rerun serve           in the browser
  convoy review run.mcap --rerun save=run.rrd    for later
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--rerun",
    default="spawn",
    show_default=True,
    metavar="spawn|serve|connect=URL|save=PATH",
    help="Where to show it.",
)
def review(log: Path, *, rerun: str) -> None:
    """Show a recorded LOG in Rerun, with the picture of a live run."""
    from scenarios import review as reviewing
    from scenarios.leash import stop_on_signals
    from transport.rerun_view import parse_rerun_option

    def wait(where: str) -> None:
        click.echo(f"look here: {where}\nCtrl-C ends it")
        stop = stop_on_signals()
        while not stop.asked:
            time.sleep(0.1)

    with clear_errors():
        count = reviewing.review(log, parse_rerun_option(rerun), wait=wait)
        click.echo(f"{count} messages drawn")


@cli.command(epilog="Example: convoy report runs/20260101-120000-lane_change/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="The summary as JSON.")
def report(log: Path, *, as_json: bool) -> None:
    """Print the tables of a recorded LOG again, also of one that breaks off."""
    import json

    from rich.console import Console

    from scenarios.report import print_summary
    from scenarios.summary import summary_of

    with clear_errors():
        summary = summary_of(log)
        if as_json:
            click.echo(json.dumps(summary, indent=2))
        else:
            print_summary(summary, log, Console())


def main() -> None:
    """Entry point of `convoy`."""
    cli()


if __name__ == "__main__":
    main()
