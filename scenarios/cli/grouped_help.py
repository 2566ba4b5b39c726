"""The `convoy` group: commands listed under headings, usage errors in one line."""

import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import click

from scenarios.cli.error_lines import error_line
from scenarios.definition.validation.wording import did_you_mean

SUMMARY_MAX = 45
"""Longest summary of a command in characters, without its full stop."""
SECTIONS: Mapping[str, Sequence[str]] = {
    "Run": ("run", "replay", "check", "list", "new"),
    "Look": (
        "runs", "report", "review", "explain", "diff", "compare", "export",
        "reference",
    ),
    "Logs": ("info", "recover"),
    "Live": (
        "status", "link", "cut", "gnss", "stall", "crash", "speed", "scenario-from",
    ),
    "Study": (
        "sweep", "bisect", "blame", "drill", "channel", "gains",
        "reproduce",
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
