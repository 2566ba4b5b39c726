"""`convoy recover`: a readable log from a truncated or damaged one."""

from pathlib import Path

import click

from scenarios.cli.error_lines import clear_errors, warn_of_log


@click.command(epilog="Example: convoy recover run.mcap -o recovered.mcap")
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="The new log.",
)
def recover(log: Path, *, output: Path) -> None:
    """Copy the readable messages of a damaged log.

    LOG is a truncated or damaged run.mcap or its folder; it is not changed.
    """
    from scenarios.results.log_queries.recovery import recover_log
    from scenarios.results.log_summary import log_in
    from transport.log.reader import LogReader

    with clear_errors():
        source = log_in(log)
        warn_of_log(LogReader(source).faults)
        count = recover_log(source, output)
        click.echo(f"{output}: {count} messages")
