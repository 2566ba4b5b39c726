"""The group of all commands.

Commands import their modules when they run, so that `convoy --help` is fast and vehicle processes
are small.
"""

import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from scenarios.cli import drill, live_commands, log_commands, paper_commands, scenario_commands
from scenarios.cli import run_commands as running
from scenarios.cli.channel_commands import channel
from scenarios.cli.comparing_commands import compare
from scenarios.cli.log_commands import export, info, recover, runs
from scenarios.cli.output import error_line, keep_output_going, unwritable_output_reported
from scenarios.cli.run_commands import replay
from scenarios.cli.scenario_commands import reference
from scenarios.cli.study_commands import bisect, blame, sweep
from scenarios.definition.wording import did_you_mean

# ---- The `convoy` group: commands listed under headings, usage errors in one line


SUMMARY_MAX = 45
"""Longest summary of a command in characters, without its full stop."""
SECTIONS: Mapping[str, Sequence[str]] = {
    "Run": ("run", "replay", "check", "list", "new"),
    "Look": (
        "runs", "report", "review", "explain", "compare", "export",
        "reference",
    ),
    "Logs": ("info", "recover"),
    "Live": (
        "status", "link", "cut", "gnss", "stall", "crash", "speed", "scenario-from",
    ),
    "Study": (
        "sweep", "bisect", "blame", "drill", "channel", "paper",
    ),
}  # fmt: skip
DEPLOYMENT = ("router", "vehicle", "record")
"""Commands that containers and other machines start: not in the list, but in the epilog."""
WORDINGS = {"\n": " ", "a valid integer range": "a whole number", "a valid float range": "a number"}


class ConvoyGroup(click.Group):
    def format_commands(
        self,
        ctx: click.Context,  # noqa: ARG002
        formatter: click.HelpFormatter,
    ) -> None:
        for heading, names in SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl(
                    [(name, self.commands[name].get_short_help_str(SUMMARY_MAX)) for name in names]
                )

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        given = list(args)
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as error:
            option = error.option_name
            with_option = [
                name
                for name in (*given, *self.commands)
                if name in self.commands
                and any(option in parameter.opts for parameter in self.commands[name].params)
            ]
            if not with_option:
                raise
            message = f"{option}: belongs after the command: convoy {with_option[0]} {option}"
            raise click.UsageError(message, ctx) from error

    def main(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        **extra: Any,
    ) -> Any:
        """Run a command and exit. A usage error is one line and exit code 2."""
        extra["standalone_mode"] = False
        try:
            exit_code = super().main(args, prog_name, **extra)
        except click.ClickException as error:
            is_help = error.message.startswith("Usage:")  # a group without a command
            click.echo(error.message if is_help else error_line(usage_error(error)), err=True)
            sys.exit(error.exit_code)
        sys.exit(exit_code if isinstance(exit_code, int) else 0)


def usage_error(error: click.ClickException) -> str:
    context = error.ctx if isinstance(error, click.UsageError) else None
    text = _lower(error.format_message())
    if isinstance(error, click.BadParameter) and error.param is not None:
        is_option = isinstance(error.param, click.Option)
        name = max(error.param.opts, key=len) if is_option else error.param.human_readable_name
        is_missing = isinstance(error, click.MissingParameter)
        text = f"{name}: {'missing' if is_missing else _lower(error.message)}"
        match = re.match(r"'(.*)' is not one of ", error.message, re.DOTALL)
        if match and isinstance(error.param.type, click.Choice):
            text = text.rstrip(".") + did_you_mean(match[1], error.param.type.choices)
    for wording, plain in WORDINGS.items():
        text = text.replace(wording, plain)
    text = text.rstrip(".")
    if context is None:
        return text
    if isinstance(error, click.NoSuchOption):
        text = f"{error.option_name}: unknown option"
        if (choice := _option_with(error.option_name.lstrip("-"), context)) is not None:
            text += f", did you mean {choice}?"
        elif error.possibilities:
            text += f", did you mean {' or '.join(sorted(error.possibilities))}?"
    return f"{text} (see {context.command_path} --help)"


def _option_with(word: str, context: click.Context) -> str | None:
    """Return the option of a command that has `word` as a value, such as "--format csv"."""
    for one in context.command.params:
        if isinstance(one.type, click.Choice) and word in one.type.choices:
            return f"{max(one.opts, key=len)} {word}"
    return None


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


# ---- Main


# One thread per process is enough for small arrays, and idle threads cost memory. OpenBLAS reads
# this when NumPy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


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
    scenario_commands.new,
    runs,
    log_commands.review,
    log_commands.report,
    log_commands.explain,
    info,
    recover,
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
    paper_commands.paper,
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
