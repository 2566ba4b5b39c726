"""`convoy replay`."""

import sys
from pathlib import Path

import click

from scenarios.cli.common_options import (
    clock_option,
    confirmation_option,
    log_options,
    output_option,
    partial_option,
    print_or_write,
    run_option,
    setting_options,
)
from scenarios.cli.display_options import DisplayOptions, Tables
from scenarios.cli.error_lines import clear_errors, warn_of_log
from scenarios.runs.stop import ignore_hangup


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
@confirmation_option
def replay(
    log: Path,
    *,
    vehicles: str,
    overrides: tuple[str, ...],
    seed: int | None,
    clock: str,
    run_name: str | None,
    out: Path | None,
    rerun: str,
    quiet: bool,
    tables: Tables,
    output: Path | None,
    partial: bool,
    confirmed: bool,
) -> None:
    """Drive live vehicles behind recorded ones.

    LOG is a run.mcap or its folder. Repeats its run, with the changes made by hand: the named
    vehicles send their recorded poses at the recorded times and under their names, and the others
    drive live. Links drop and delay messages as in any run. The new log also holds the true poses
    of the replayed vehicles. With the settings and the seed of LOG, a virtual run gives the
    recorded followers again, bit for bit.
    """
    from scenarios.cli.running.launching import RunOptions, replay_run
    from scenarios.results.log_queries.session import replayed_session
    from scenarios.results.log_summary import log_in

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
        sys.exit(
            replay_run(
                scenario,
                RunOptions(
                    clock=clock,
                    display=DisplayOptions(rerun, quiet, tables),
                    run_name=run_name,
                    out=out,
                    confirmed=confirmed,
                ),
            )
        )
