"""Commands that look at scenarios, logs and the science; `scenarios.cli` joins them in."""

import sys
from pathlib import Path

import click

from scenarios.cli.failure import clear_errors
from scenarios.cli.options import scenario_options


@click.command(name="list", epilog="Example: convoy list")
def list_scenarios() -> None:
    """List the scenarios that ship."""
    from scenarios.definition.scenario import library, load_scenario

    for name in library():
        click.echo(f"{name:20} {load_scenario(name).tables.description}")


@click.command(
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

    from scenarios.cli.tables import check_table
    from scenarios.definition.check.certificate import certificate_warnings
    from scenarios.definition.check.report import report_of
    from scenarios.definition.scenario import load_scenario

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


@click.command(
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

    from scenarios.cli.tables import gains_table
    from scenarios.studies.gains.report import DEFAULT_SPEEDS, gains_report
    from vehicles.car.parameters import LINCOLN_MKZ, Gains

    with clear_errors():
        report = gains_report(LINCOLN_MKZ, Gains(*gains), speeds or DEFAULT_SPEEDS, out_dir=out)
        Console().print(gains_table(report))
        click.echo(f"written: {out / 'gains.json'} and {len(report.pictures)} pictures")


@click.command(epilog="Example: convoy new > my.toml")
@click.argument("file", required=False, type=click.Path(dir_okay=False, path_type=Path))
def new(file: Path | None) -> None:
    """Write a commented scenario with every option to FILE, or to standard output."""
    from scenarios.definition.scenario import template

    with clear_errors():
        if file is None:
            click.echo(template(), nl=False)
        else:
            with file.open("x", encoding="utf-8") as target:
                target.write(template())
            click.echo(f"wrote {file}; try it: convoy run {file}")


@click.command(
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
    from scenarios.results import review as reviewing
    from scenarios.runs.stop import stop_on_signals
    from transport.clock import poll
    from transport.picture.option import parse_rerun_option

    def wait(where: str) -> None:
        click.echo(f"look here: {where}\nCtrl-C ends it")
        stop = stop_on_signals()
        poll(lambda: stop.asked, every_s=0.1)

    with clear_errors():
        count = reviewing.review(log, parse_rerun_option(rerun), wait=wait)
        click.echo(f"{count} messages drawn")


@click.command(epilog="Example: convoy report runs/20260101-120000-lane_change/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="The summary as JSON.")
def report(log: Path, *, as_json: bool) -> None:
    """Print the tables of a recorded LOG again, also of one that breaks off."""
    from rich.console import Console

    from scenarios.cli.tables import print_summary
    from scenarios.results.log_summary import summary_of
    from scenarios.results.summary import to_json

    with clear_errors():
        summary = summary_of(log)
        if as_json:
            click.echo(to_json(summary), nl=False)
        else:
            print_summary(summary, log, Console())


@click.command(
    epilog="""\b
Examples:
  convoy reproduce --out paper                   all of it, in a minute or two
  convoy reproduce --case base --case a
"""
)
@click.option("--case", "cases", multiple=True, metavar="NAME", help="Only this case; repeatable.")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("paper"),
    show_default=True,
    help="Folder for the report, its pictures and the logs.",
)
def reproduce(*, cases: tuple[str, ...], out: Path) -> None:
    """Run the paper's experiments and write a report: each claim against what comes out here."""
    from scenarios.studies.paper.reproduce import reproduce as carry_out

    with clear_errors():
        sys.exit(carry_out(cases, out, click.echo))


COMMANDS = (list_scenarios, check, gains, new, review, report, reproduce)
