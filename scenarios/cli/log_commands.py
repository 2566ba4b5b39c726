"""Commands that read recorded runs: review, report, explain."""

from pathlib import Path

import click

from scenarios.cli.common_options import json_option, rerun_option, tables_option, time_option
from scenarios.cli.display_options import Tables
from scenarios.cli.error_lines import clear_errors, warn_of_log
from scenarios.definition.errors import require


@click.command(
    epilog="""\b
Examples:
  convoy review runs/20260101-120000-lane_change/run.mcap
  convoy review run.mcap --serve           in a browser
  convoy review run.mcap --save run.rrd    into a file
  convoy review run.mcap --from 100 --to 160 --vehicles v3,v4 --at 120
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@rerun_option("spawn", "Show the run in Rerun", "Default.")
@time_option("--from", help_text="Show the run from this time after its start.")
@time_option("--to", help_text="Show the run up to this time after its start.")
@click.option(
    "--vehicles",
    default="",
    metavar="NAMES",
    help="Show these vehicles and the lead, such as v2,v5. Default: all.",
)
@time_option("--at", help_text="Open the viewer at this time after the start.")
def review(
    log: Path,
    *,
    rerun: str,
    from_s: float | None,
    to_s: float | None,
    vehicles: str,
    at_s: float | None,
) -> None:
    """Show a recorded run in Rerun.

    LOG is a run.mcap or its folder.
    """
    from scenarios.cli.output import progress_of, wait_until_stopped
    from scenarios.results.log_summary import log_in
    from scenarios.results.pictures import review as reviewing
    from transport.picture.option import parse_rerun_option

    with clear_errors():
        option = parse_rerun_option(rerun)
        require("review", "viewer", "rerun")
        names = [name.strip() for name in vehicles.split(",") if name.strip()]
        excerpt = reviewing.Excerpt(from_s, to_s, names or None)
        show = progress_of("% drawn")
        count = reviewing.review(
            log_in(log),
            option,
            wait=wait_until_stopped,
            excerpt=excerpt,
            progress=lambda share: show(round(100 * share), 100),
            at_s=at_s,
        )
        click.echo(f"{count} messages drawn")


@click.command(
    epilog="""\b
Examples:
  convoy report runs/20260101-120000-lane_change/run.mcap
  convoy report run.mcap --html run.html    one file that needs no network
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--html",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write tables and pictures into one HTML file instead, for any browser. An existing"
    " file is replaced.",
)
@json_option("Print the summary as JSON.")
@tables_option("all")
def report(log: Path, *, html: Path | None, as_json: bool, tables: Tables) -> None:
    """Print the tables of a recorded run.

    LOG is a run.mcap or its folder. It may be incomplete, damaged, or of a run that still runs.
    """
    from rich.console import Console

    from scenarios.cli.summary_tables import print_summary
    from scenarios.results.log_summary import log_in, summary_of
    from scenarios.results.summary import to_json
    from scenarios.runs.run_folder import is_running

    with clear_errors():
        log = log_in(log)
        summary = summary_of(log, warn_of_log, running=is_running(log))
        if html is not None:
            from scenarios.results.recorded.run_record import RunRecord
            from scenarios.results.report.page import write_report

            write_report(RunRecord(log), html, summary)
            click.echo(f"written: {html}", err=as_json)
        if as_json:
            click.echo(to_json(summary), nl=False)
        elif html is None:
            print_summary(summary, log, Console(), tables)


@click.command(
    epilog="""\b
Examples:
  convoy explain runs/20260101-120000-lossy_lane_change/run.mcap --vehicle v3 --at 12.4
  convoy explain run.mcap --vehicle v3 --at 12.4 --json
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--vehicle", required=True, metavar="NAME", help="Name of the vehicle.")
@time_option("--at", required=True, help_text="Time after the start of the run.")
@json_option("Print the explanation as JSON.")
def explain(log: Path, *, vehicle: str, at_s: float, as_json: bool) -> None:
    """Explain what a vehicle knew at a time.

    LOG is a run.mcap or its folder. Lists the newest message from each source, the messages that
    are missing, and the cause of each loss.
    """
    import json
    from dataclasses import asdict

    from rich.console import Console

    from scenarios.cli.channel.explanation_table import print_explanation
    from scenarios.results.log_queries import explain as explaining
    from scenarios.results.log_summary import log_in

    with clear_errors():
        explanation = explaining.explain(log_in(log), vehicle, at_s)
        warn_of_log(explanation.log_faults)
        if as_json:
            fields = asdict(explanation) | {"sentence": explanation.sentence}
            click.echo(json.dumps(fields, indent=2))
        else:
            print_explanation(explanation, Console())
