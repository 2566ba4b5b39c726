"""The command line: `convoy COMMAND …`.

Each command imports what it needs when it runs, so that a vehicle process stays small and
`convoy --help` is quick.
"""

import os
import sys
from pathlib import Path

# One thread per process is plenty for arrays of forty numbers, and the spare ones cost memory.
# NumPy's library reads it when it is loaded, so it comes before everything else.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from scenarios.cli import log_commands, paper_commands, scenario_commands
from scenarios.cli.channel.channel_commands import channel
from scenarios.cli.guide.reference import reference
from scenarios.cli.live import live_commands
from scenarios.cli.many import drill, worst
from scenarios.cli.many.bisect import bisect
from scenarios.cli.many.blame import blame
from scenarios.cli.many.risk import risk
from scenarios.cli.many.sweep import sweep
from scenarios.cli.output import keep_output_going, unwritable_output_reported
from scenarios.cli.running import commands as running

EXAMPLES = """\b
Examples:
  convoy run                              the default scenario, real processes
  convoy run church_lot --rerun spawn     watch it live
  convoy run lossy_lane_change --clock virtual --seed 7
  convoy run my.toml --set links.loss_ratio=0.3
  convoy review runs/…/run.mcap           the same picture from the log

\b
With this, Tab completes scenarios, --set keys and vehicles, where convoy is on
the path:
  eval "$(_CONVOY_COMPLETE=bash_source convoy)"    in bash
  eval "$(_CONVOY_COMPLETE=zsh_source convoy)"     in zsh
  _CONVOY_COMPLETE=fish_source convoy | source     in fish
"""


@click.group(epilog=EXAMPLES, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="convoy-emulator")
def cli() -> None:
    """Emulate a convoy: a process per vehicle, poses over Zenoh, logs in MCAP, live in Rerun."""


for command in (
    running.run,
    running.router,
    running.vehicle,
    running.record,
    scenario_commands.list_scenarios,
    scenario_commands.check,
    paper_commands.gains,
    scenario_commands.new,
    log_commands.review,
    log_commands.report,
    log_commands.explain,
    blame,
    channel,
    sweep,
    live_commands.link,
    live_commands.cut,
    live_commands.heal,
    live_commands.gnss,
    live_commands.stall,
    live_commands.kill,
    live_commands.speed,
    live_commands.status,
    live_commands.scenario_from,
    drill.drill,
    worst.worst,
    paper_commands.reproduce,
    bisect,
    risk,
    reference,
):
    cli.add_command(command)


def main() -> None:
    """Run the command of `sys.argv`; `scenarios.cli.__main__` handles signals by then."""
    keep_output_going()
    # A user's own controller may be in the working folder; installed packages come first.
    sys.path.append(str(Path.cwd()))
    with unwritable_output_reported():
        cli(prog_name="convoy")
