"""`convoy extract` and `convoy merge`: logs from parts of logs."""

from collections.abc import Callable
from pathlib import Path

import click

from scenarios.cli.common_options import Command, time_option
from scenarios.cli.error_lines import clear_errors, warn_of_log

NEW_LOG = click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="The new log.",
)


def names_option(name: str, example: str) -> Callable[[Command], Command]:
    """Option for names separated by commas."""
    help_text = f"Keep these {name[2:]}, such as {example}. Default: all."
    return click.option(name, default="", metavar="NAMES", help=help_text)


def names_in(text: str) -> list[str] | None:
    return [name.strip() for name in text.split(",") if name.strip()] or None


@click.command(
    epilog="""\b
Examples:
  convoy extract run.mcap --from 100 --to 160 -o bend.mcap
  convoy extract run.mcap --vehicles v1,v2 --topics gps,truth -o two.mcap
"""
)
@click.argument("log", type=click.Path(path_type=Path))
@time_option("--from", help_text="Keep messages from this time after the start of the run.")
@time_option("--to", help_text="Keep messages up to this time after the start.")
@names_option("--topics", "truth,tracking")
@names_option("--vehicles", "v1,v2")
@NEW_LOG
def extract(
    log: Path,
    *,
    from_s: float | None,
    to_s: float | None,
    topics: str,
    vehicles: str,
    output: Path,
) -> None:
    """Copy times, topics or vehicles of a log.

    LOG is a run.mcap or its folder. The new log keeps the start, the road, the scenario, and a
    summary of what it holds. Messages for other programs are kept with the topic of which they are
    made.
    """
    from scenarios.results.log_queries import log_pieces
    from scenarios.results.log_summary import log_in

    with clear_errors():
        part = log_pieces.LogPart(from_s, to_s, names_in(topics), names_in(vehicles))
        count = log_pieces.extract(log_in(log), part, output, warn_of_log)
        click.echo(f"{output}: {count} messages")


@click.command(epilog="Example: convoy merge first.mcap second.mcap -o both.mcap")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))
@NEW_LOG
def merge(logs: tuple[Path, ...], *, output: Path) -> None:
    """Join logs of one run.

    LOGS are pieces of one log, or recordings of one run. Messages in several of them are written
    once. The new log is a piece too, unless LOGS together hold the whole run.
    """
    from scenarios.results.log_queries import log_pieces
    from scenarios.results.log_summary import log_in

    with clear_errors():
        paths = [log_in(log) for log in logs]
        count, is_whole = log_pieces.merge_logs(paths, output, warn_of_log)
        click.echo(
            f"{output}: {count} messages, {'the whole run' if is_whole else 'a piece of it'}"
        )
