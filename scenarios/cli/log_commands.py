"""Commands that look at the logs of runs."""

from pathlib import Path

import click

from scenarios.cli.error_lines import clear_errors, require
from scenarios.cli.guide import completion


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
    shell_complete=completion.rerun,
    help="Where to show it.",
)
def review(log: Path, *, rerun: str) -> None:
    """Show a recorded LOG, or the one in a run's folder, in Rerun: the picture of a live run."""
    from scenarios.results.log_summary import log_in
    from scenarios.results.pictures import review as reviewing
    from scenarios.runs.stop import stop_on_signals
    from transport.clock import poll
    from transport.picture.option import parse_rerun_option

    def wait(where: str) -> None:
        click.echo(f"look here: {where}\nCtrl-C ends it")
        stop = stop_on_signals()
        poll(lambda: stop.requested, every_s=0.1)

    with clear_errors():
        option = parse_rerun_option(rerun)
        require("review", "viewer", "rerun")
        count = reviewing.review(log_in(log), option, wait=wait)
        click.echo(f"{count} messages drawn")


@click.command(epilog="Example: convoy report runs/20260101-120000-lane_change/run.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="The summary as JSON.")
def report(log: Path, *, as_json: bool) -> None:
    """Print the tables of a recorded LOG, or the one in a run's folder, also if it breaks off."""
    from rich.console import Console

    from scenarios.cli.summary_tables import print_summary
    from scenarios.results.log_summary import log_in, summary_of
    from scenarios.results.summary import to_json

    with clear_errors():
        log = log_in(log)
        summary = summary_of(log, warn=lambda line: click.echo(f"warning: {line}", err=True))
        if as_json:
            click.echo(to_json(summary), nl=False)
        else:
            print_summary(summary, log, Console())


@click.command(
    epilog="""\b
Examples:
  convoy explain runs/20260101-120000-lossy_lane_change/run.mcap --vehicle v3 --at 12.4
  convoy explain run.mcap --vehicle v3 --at 12.4 --json
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--vehicle", required=True, help="Which vehicle.")
@click.option("--at", "at_s", required=True, type=float, help="Seconds after the start.")
@click.option("--json", "as_json", is_flag=True, help="As JSON.")
def explain(log: Path, *, vehicle: str, at_s: float, as_json: bool) -> None:
    """Say what a vehicle knew at an instant of a recorded LOG, and why it knew no more."""
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.cli.channel.explanation_table import print_explanation
    from scenarios.results.log_queries import explain as explaining
    from scenarios.results.log_summary import log_in

    with clear_errors():
        found = explaining.explain(log_in(log), vehicle, at_s)
        if as_json:
            click.echo(json.dumps(asdict(found) | {"sentence": found.sentence}, indent=2))
        else:
            print_explanation(found, Console())
