"""The group of all commands.

Commands import their modules when they run, so that `convoy --help` is fast and vehicle processes
are small.
"""

import os
import sys
from pathlib import Path

# One thread per process is enough for small arrays, and idle threads cost memory. OpenBLAS reads
# this when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import click

from scenarios.cli import log_commands, paper_commands, scenario_commands
from scenarios.cli.channel.channel_commands import channel
from scenarios.cli.comparing.compare import compare
from scenarios.cli.comparing.diff import diff
from scenarios.cli.grouped_help import ConvoyGroup
from scenarios.cli.live import live_commands
from scenarios.cli.logs.info_command import info
from scenarios.cli.logs.recover_command import recover
from scenarios.cli.many import drill
from scenarios.cli.many.bisect import bisect
from scenarios.cli.many.blame import blame
from scenarios.cli.many.sweep import sweep
from scenarios.cli.output import keep_output_going, unwritable_output_reported
from scenarios.cli.reference.reference_command import reference
from scenarios.cli.running import commands as running
from scenarios.cli.running.replay_command import replay
from scenarios.cli.tables.export_command import export
from scenarios.cli.tables.runs_command import runs

EXAMPLES = """
Deployments start the parts of a convoy by `convoy router`, `convoy vehicle` and `convoy record`.

\b
Examples:
  convoy run                              the default scenario, in real time
  convoy run church_lot --spawn           with a live view in Rerun
  convoy run lossy_lane_change --clock virtual --seed 7
  convoy run my.toml --loss 0.3 --duration 20s
  convoy check drive.gpx --out drive.svg  a recorded drive of your own
  convoy report runs/…/run.mcap           the tables of a recorded run

\b
Shell completion of commands, options and scenarios:
  eval "$(_CONVOY_COMPLETE=bash_source convoy)"    in bash
  eval "$(_CONVOY_COMPLETE=zsh_source convoy)"     in zsh
  _CONVOY_COMPLETE=fish_source convoy | source     in fish
"""


@click.group(
    "convoy",
    cls=ConvoyGroup,
    epilog=EXAMPLES,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(package_name="convoy-emulator")
def cli() -> None:
    """Emulate a convoy of cars whose radio links delay and lose messages.

    Every vehicle is a process that sends its GPS pose over Zenoh. Runs are recorded in MCAP and
    shown in Rerun.
    """


for command in (
    running.run,
    replay,
    running.router,
    running.vehicle,
    running.record,
    scenario_commands.list_scenarios,
    scenario_commands.check,
    paper_commands.gains,
    scenario_commands.new,
    runs,
    log_commands.review,
    log_commands.report,
    log_commands.explain,
    info,
    recover,
    diff,
    compare,
    export,
    blame,
    channel,
    sweep,
    live_commands.link,
    live_commands.cut,
    live_commands.gnss,
    live_commands.stall,
    live_commands.crash,
    live_commands.speed,
    live_commands.status,
    live_commands.scenario_from,
    drill.drill,
    paper_commands.reproduce,
    bisect,
    reference,
):
    cli.add_command(command)


def main() -> None:
    """Run the command in `sys.argv`. `scenarios.cli.__main__` has set the signal handlers."""
    keep_output_going()
    # For a user's controller in the working folder. Installed packages take precedence.
    sys.path.append(str(Path.cwd()))
    with unwritable_output_reported():
        cli(prog_name="convoy")
