"""Options that the commands for a convoy that drives have in common."""

import re
from collections.abc import Callable
from typing import Any, TypeVar

import click

from scenarios.cli.options import zenoh_options

Command = TypeVar("Command", bound=Callable[..., Any])
_UNITS_S = {"": 1.0, "s": 1.0, "ms": 0.001, "min": 60.0}
_SPAN = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+) ?(s|ms|min|)")


class TimeSpan(click.ParamType[float]):
    """A span of time in s, such as 5s, 500ms or 2min."""

    name = "span"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Read it."""
        if isinstance(value, float):
            return value
        found = _SPAN.fullmatch(str(value).strip())
        if found is None:
            self.fail(f"given {value!r}, allowed a time such as 5s, 500ms or 2min", param, ctx)
        return float(found[1]) * _UNITS_S[found[2]]


def run_options(command: Command) -> Command:
    """`--run` and Zenoh's usual flags."""
    named = click.option(
        "--run",
        "run_name",
        metavar="NAME",
        help="Which run; by default the only one that `convoy run` drives here.",
    )
    return named(zenoh_options(command))


def span_option(*, required: bool = False, help_text: str) -> Callable[[Command], Command]:
    """`--for`."""
    return click.option(
        "--for", "for_s", type=TimeSpan(), required=required, metavar="TIME", help=help_text
    )
