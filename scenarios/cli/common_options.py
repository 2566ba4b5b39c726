"""Options that several commands share."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce, wraps
from math import isfinite
from pathlib import Path
from typing import Any, Literal, TypeVar

import click
from click import Context, Parameter
from click.shell_completion import CompletionItem

from scenarios.results.figure_style import PICTURE_FORMATS
from transport.bus.zenoh_options import ZenohOptions

# ---- Shell completion of scenarios; Click completes commands and options itself
#
# Each press of Tab starts a process, so imports are lazy.


OWN_FILES = (".toml", ".csv", ".geojson", ".gpx", ".kml", ".mcap", ".nmea", ".pos")
"""Suffixes of scenarios and recorded drives."""


def scenarios(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    own = sorted(path.name for path in Path().iterdir() if path.suffix.lower() in OWN_FILES)
    known = [one for one in (*library(), *own) if one.startswith(incomplete)]
    return [CompletionItem(one) for one in known] or [CompletionItem(incomplete, type="file")]


# ---- Options for what a run displays and prints


Tables = Literal["news", "all"]
"""Printed tables: that of the vehicles and those with news, or all."""


@dataclass(frozen=True, slots=True)
class DisplayOptions:
    rerun: str = "off"
    quiet: bool = False
    tables: Tables = "news"

    @property
    def arguments(self) -> Sequence[str]:
        """The same options for another `convoy` command."""
        quiet = ["--quiet"] if self.quiet else []
        return ["--rerun", self.rerun, "--tables", self.tables, *quiet]


def start_line(run: str, folder: Path, endpoint: str = "") -> str:
    router = f", router {endpoint}" if endpoint else ""
    return f"run {run}: writes {folder}/{router}"


# ---- Common options


Command = TypeVar("Command", bound=Callable[..., Any])
_UNITS_S = {"": 1.0, "s": 1.0, "ms": 0.001, "min": 60.0}
_TIME = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?(s|ms|min|)")
TIME_MAX_S = 1e6
"""Longest time that an option accepts; the longest simulation is shorter."""


class FiniteRange(click.FloatRange):
    """A finite number within bounds; `click.FloatRange` accepts NaN and mostly infinity."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Ratio(FiniteRange):
    """A number from 0 to 1."""

    def __init__(self) -> None:
        super().__init__(0.0, 1.0)

    def _describe_range(self) -> str:
        return ""  # the help text contains it

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        text = str(value).strip()
        percent = text.removesuffix("%").strip()
        try:
            number = float(percent)
        except ValueError:
            return super().convert(value, param, ctx)
        if 1.0 < number <= 100.0 or percent != text:
            hint = f", did you mean {number / 100.0:g}?" if 0.0 <= number <= 100.0 else ""
            self.fail(f"given {text}, allowed 0 to 1{hint}", param, ctx)
        return super().convert(value, param, ctx)


class Time(click.ParamType[float]):
    """A time in s, such as 12.4, 5s, 500ms or 2min."""

    name = "time"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        if isinstance(value, float):
            return value
        match = _TIME.fullmatch(str(value).strip())
        if match is None:
            text = str(value)
            given = text if len(text) <= 40 else f"{text[:37]}..."
            self.fail(f"given {given!r}, allowed a time such as 12.4, 5s or 500ms", param, ctx)
        seconds = float(match[1]) * _UNITS_S[match[2]]
        if seconds > TIME_MAX_S:
            self.fail(f"given {seconds:g} s, allowed up to {TIME_MAX_S:g} s", param, ctx)
        return seconds


def time_option(
    name: str, *, help_text: str, required: bool = False, **more: Any
) -> Callable[[Command], Command]:
    parameter = f"{name.strip('-')}_s"
    return click.option(
        name, parameter, type=Time(), required=required, metavar="TIME", help=help_text, **more
    )


def together(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Several options as one decorator, in the order of the help."""

    def decorate(command: Command) -> Command:
        return reduce(lambda decorated, option: option(decorated), reversed(options), command)

    return decorate


seed_option = click.option(
    "--seed", type=click.IntRange(min=0), metavar="N", help="Replace the scenario's seed."
)


def override_options(command: Command) -> Command:
    """Options that override settings: the command receives them all as `overrides`."""

    @wraps(command)
    def with_overrides(
        *args: Any,
        overrides: tuple[str, ...],
        duration_s: float | None,
        loss_ratio: float | None,
        **options: Any,
    ) -> Any:
        short = {"duration_s": duration_s, "links.loss_ratio": loss_ratio}
        given = [f"{key}={value:.12g}" for key, value in short.items() if value is not None]
        return command(*args, overrides=(*overrides, *given), **options)

    decorated: Any = with_overrides
    chosen: Command = SHORT_SETTINGS(decorated)
    return chosen


SHORT_SETTINGS = together(
    click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the scenario, such as convoy.gap_m=12. Repeatable.",
    ),
    time_option(
        "--duration",
        help_text="Length of the run. Same as --set duration_s=SECONDS, but accepts 20, 20s or"
        " 500ms.",
    ),
    click.option(
        "--loss",
        "loss_ratio",
        type=Ratio(),
        metavar="RATIO",
        help="Loss ratio of the links, 0 to 1. Short for --set links.loss_ratio=RATIO.",
    ),
)
setting_options = together(override_options, seed_option)
scenario_options = together(
    click.argument("scenario", default="lane_change", shell_complete=scenarios), setting_options
)


def tables_option(default: str) -> Callable[[Command], Command]:
    return click.option(
        "--tables",
        type=click.Choice(["news", "all"]),
        default=default,
        show_default=True,
        help="news: the table of vehicles, and tables with something unusual, such as late ticks,"
        " cut links, stops or events. all: every table.",
    )


def rerun_option(default: str, purpose: str, usual: str = "") -> Callable[[Command], Command]:
    """Options with Rerun's names for the destination of a picture; the command receives `rerun`.

    `usual` states when the native viewer is the default. Options that the command has already, as
    Zenoh's `--connect`, are left out.
    """

    def decorate(command: Command) -> Command:
        @wraps(command)
        def with_destination(*args: Any, rerun: str | None = None, **options: Any) -> Any:
            given = {name: options.pop(_parameter(name), None) for name in DESTINATIONS}
            given = {name: value for name, value in given.items() if value not in {None, False}}
            if len(given) > 1:
                names = " and ".join(f"--{name}" for name in given)
                raise click.UsageError(f"{names}: give one of them")
            for name, value in given.items():
                sink = name.removesuffix("-at")
                rerun = sink if value is True else f"{sink}={value}"
            return command(*args, rerun=default if rerun is None else rerun, **options)

        decorated: Any = with_destination
        parameters = decorated.__dict__.setdefault("__click_params__", [])
        taken = {name for parameter in parameters for name in parameter.opts}
        parameters += [
            option for option in _destinations(purpose, usual) if taken.isdisjoint(option.opts)
        ]
        chosen: Command = decorated
        return chosen

    return decorate


DESTINATIONS = ("spawn", "serve", "serve-at", "connect", "save")


def _parameter(name: str) -> str:
    return f"rerun_{name.replace('-', '_')}"


def _destinations(purpose: str, usual: str) -> list[click.Option]:
    """Options for the destination, in the reverse order of the help."""

    def option(name: str, help_text: str, **more: Any) -> click.Option:
        return click.Option([f"--{name}", _parameter(name)], help=help_text, **more)

    return [
        option("save", "The same into a file, such as run.rrd.", metavar="FILE"),
        option("connect", "The same in the running viewer with this URL.", metavar="URL"),
        option(
            "serve-at",
            "The same on other ports, or for other machines.",
            metavar="[ADDRESS:]PORT[:DATA_PORT]",
        ),
        option("serve", "The same in a browser.", is_flag=True),
        option("spawn", f"{purpose}, in a new native viewer. {usual}".strip(), is_flag=True),
    ]


log_options = together(
    click.option(
        "--out",
        type=click.Path(file_okay=False, path_type=Path),
        help="Folder for run.mcap and summary.json. Default: runs/START-SCENARIO-OVERRIDES.",
    ),
    rerun_option("off", "Show the run in Rerun while it is recorded"),
    tables_option("news"),
    click.option("--quiet", is_flag=True, help="Print errors and warnings only."),
)
zenoh_options = together(
    click.option("-m", "--mode", type=click.Choice(["client", "peer"]), help="Zenoh session mode."),
    click.option(
        "-e",
        "--connect",
        multiple=True,
        metavar="ENDPOINT",
        help="Connect to this endpoint, such as tcp/127.0.0.1:7447.",
    ),
    click.option(
        "-l", "--listen", multiple=True, metavar="ENDPOINT", help="Listen on this endpoint."
    ),
    click.option(
        "-c",
        "--config",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="Zenoh configuration file.",
    ),
    click.option(
        "--cfg", multiple=True, metavar="KEY:VALUE", help="Zenoh setting in JSON5. Repeatable."
    ),
)


def folder_option(default: str, help_text: str) -> Callable[[Command], Command]:
    return click.option(
        "--out",
        type=click.Path(file_okay=False, path_type=Path),
        default=Path(default),
        show_default=True,
        help=help_text,
    )


picture_format_option = click.option(
    "--picture-format",
    type=click.Choice(PICTURE_FORMATS),
    default="png",
    show_default=True,
    help="Format of the plots.",
)


def output_option(help_text: str) -> Callable[[Command], Command]:
    return click.option(
        "-o",
        "--output",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="FILE",
        help=help_text,
    )


def json_option(help_text: str) -> Callable[[Command], Command]:
    return click.option("--json", "as_json", is_flag=True, help=help_text)


partial_option = click.option(
    "--partial",
    is_flag=True,
    help="Use a damaged or incomplete log; the result states what is missing.",
)


def link_option(help_text: str) -> Callable[[Command], Command]:
    return click.option("--link", metavar="SENDER:RECEIVER", help=help_text)


def print_or_write(text: str, file: Path | None) -> None:
    """Print a text, or write it to a new file; raises FileExistsError."""
    if file is None:
        click.echo(text, nl=False)
        return
    from scenarios.results.files import write_whole

    write_whole(file, text.encode(), new=True)
    click.echo(f"written: {file}")


run_option = click.option(
    "--run",
    "run_name",
    metavar="NAME",
    help="Name of the run, which keeps convoys on one router apart. Default: the scenario's"
    " name, with a random suffix in `convoy run`.",
)


clock_option = click.option(
    "--clock",
    type=click.Choice(["wall", "virtual"]),
    default="wall",
    show_default=True,
    help="Real time with one process per vehicle (wall), or as fast as possible (virtual).",
)


open_run_options = together(
    click.option(
        "--run",
        "run_name",
        metavar="NAME",
        help="Name of the run. Default: the only run that `convoy run` started on this machine.",
    ),
    zenoh_options,
)


parent_watch_option = click.option(
    "--parent-watch",
    "launched",
    is_flag=True,
    hidden=True,
    help="Stop when standard input ends.",
)
"""Hidden option of processes that must not outlive their parent."""


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
