"""Options that several commands share."""

import re
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click

from scenarios.cli.guide import completion
from transport.bus.zenoh_options import ZenohOptions

Command = TypeVar("Command", bound=Callable[..., Any])
_UNITS_S = {"": 1.0, "s": 1.0, "ms": 0.001, "min": 60.0}
_SPAN = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?(s|ms|min|)")


class FiniteRange(click.FloatRange):
    """A finite number within bounds; click's own range lets NaN and mostly infinity pass."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class TimeSpan(click.ParamType[float]):
    """A span of time in s, such as 5s, 500ms or 2min."""

    name = "span"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        if isinstance(value, float):
            return value
        found = _SPAN.fullmatch(str(value).strip())
        if found is None:
            self.fail(f"given {value!r}, allowed a time such as 5s, 500ms or 2min", param, ctx)
        return float(found[1]) * _UNITS_S[found[2]]


def scenario_options(command: Command) -> Command:
    named = click.argument("scenario", default="lane_change", shell_complete=completion.scenarios)
    return named(setting_options(command))


def setting_options(command: Command) -> Command:
    for decorate in (
        click.option("--seed", type=click.IntRange(min=0), help="Seed instead of the scenario's."),
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            shell_complete=completion.settings,
            help="Override a scenario value, such as links.loss_ratio=0.2. May be repeated.",
        ),
    ):
        command = decorate(command)
    return command


def log_options(command: Command) -> Command:
    for decorate in (
        click.option("--quiet", is_flag=True, help="Print only what goes wrong."),
        click.option(
            "--rerun",
            default="off",
            show_default=True,
            metavar="off|spawn|serve|connect=URL|save=PATH",
            shell_complete=completion.rerun,
            help="Show the run in Rerun while it goes on.",
        ),
        click.option(
            "--out",
            type=click.Path(file_okay=False, path_type=Path),
            help="Folder for run.mcap and summary.json; by default runs/<start>-<scenario>/, the"
            " overrides behind the name.",
        ),
    ):
        command = decorate(command)
    return command


def zenoh_options(command: Command) -> Command:
    for decorate in (
        click.option("--cfg", multiple=True, metavar="KEY:VALUE", help="Zenoh setting, in JSON5."),
        click.option(
            "-c",
            "--config",
            type=click.Path(exists=True, dir_okay=False, path_type=Path),
            help="Zenoh configuration file.",
        ),
        click.option("-l", "--listen", multiple=True, metavar="ENDPOINT", help="Listen here."),
        click.option(
            "-e",
            "--connect",
            multiple=True,
            metavar="ENDPOINT",
            help="Connect there, such as tcp/127.0.0.1:7447.",
        ),
        click.option(
            "-m", "--mode", type=click.Choice(["client", "peer"]), help="Zenoh session mode."
        ),
    ):
        command = decorate(command)
    return command


def folder_option(default: str, help_text: str) -> Callable[[Command], Command]:
    return click.option(
        "--out",
        type=click.Path(file_okay=False, path_type=Path),
        default=Path(default),
        show_default=True,
        help=help_text,
    )


def new_file_option(command: Command) -> Command:
    return click.option(
        "-o",
        "--out",
        type=click.Path(dir_okay=False, path_type=Path),
        help="Write to this new file.",
    )(command)


def print_or_write(text: str, file: Path | None) -> None:
    """Print a text, or write it to a new file; raises FileExistsError."""
    if file is None:
        click.echo(text, nl=False)
        return
    with file.open("x", encoding="utf-8") as target:
        target.write(text)
    click.echo(f"written: {file}")


def run_option(command: Command) -> Command:
    return click.option(
        "--run",
        "run_name",
        metavar="NAME",
        help="Name of the run: its processes hear only one another. By default the scenario's"
        " name; `convoy run` makes one up.",
    )(command)


def open_run_options(command: Command) -> Command:
    named = click.option(
        "--run",
        "run_name",
        metavar="NAME",
        help="Which run; by default the only one that `convoy run` drives here.",
    )
    return named(zenoh_options(command))


def span_option(*, required: bool = False, help_text: str) -> Callable[[Command], Command]:
    return click.option(
        "--for", "for_s", type=TimeSpan(), required=required, metavar="TIME", help=help_text
    )


def parent_watch_option(command: Command) -> Command:
    """`--leash`, for processes that must not outlive their parent."""
    return click.option(
        "--leash",
        "launched",
        is_flag=True,
        help="Stop when standard input ends (set by `convoy run`).",
    )(command)


def zenoh_from(flags: dict[str, Any], run: str = "") -> ZenohOptions:
    """Return the Zenoh flags of a command; by default of a client of the local router."""
    return ZenohOptions(
        mode=flags["mode"],
        connect=flags["connect"],
        listen=flags["listen"],
        config=flags["config"],
        cfg=flags["cfg"],
        run=run,
        connect_timeout_s=flags.get("connect_timeout_s", 10.0),
    )
