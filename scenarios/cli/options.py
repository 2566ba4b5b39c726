"""Options that several commands share."""

from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar

import click

from scenarios.cli.guide import completion
from transport.bus.zenoh_options import ZenohOptions

Command = TypeVar("Command", bound=Callable[..., Any])


class FiniteRange(click.FloatRange):
    """A number within bounds. Of click's own range NaN is outside of none, and infinity rarely."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """The number of a text; refuses one that is not finite."""
        number = float(super().convert(value, param, ctx))
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


def scenario_options(command: Command) -> Command:
    """SCENARIO, `--set` and `--seed`."""
    named = click.argument("scenario", default="lane_change", shell_complete=completion.scenarios)
    return named(setting_options(command))


def setting_options(command: Command) -> Command:
    """`--set` and `--seed`."""
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
    """`--out`, `--rerun` and `--quiet`."""
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
    """Zenoh's usual flags."""
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


def run_option(command: Command) -> Command:
    """`--run`, the name that all processes of one run share."""
    return click.option(
        "--run",
        "run_name",
        metavar="NAME",
        help="Name of the run: its processes hear only one another. By default the scenario's"
        " name; `convoy run` makes one up.",
    )(command)


def leash_option(command: Command) -> Command:
    """`--leash`, for processes that must not outlive the one that started them."""
    return click.option(
        "--leash", is_flag=True, help="Stop when standard input ends (set by `convoy run`)."
    )(command)


def zenoh_from(flags: dict[str, Any], run: str = "") -> ZenohOptions:
    """The Zenoh flags of a command as one value; by default a client of the local router.

    `run` is the name of the run that the process takes part in.
    """
    return ZenohOptions(
        mode=flags["mode"],
        connect=flags["connect"],
        listen=flags["listen"],
        config=flags["config"],
        cfg=flags["cfg"],
        run=run,
        connect_timeout_s=flags.get("connect_timeout_s", 10.0),
    )
