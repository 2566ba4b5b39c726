"""Help pages, options that several commands share, and usage errors."""

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner, Result

from scenarios.cli.main import DEPLOYMENT, SECTIONS, SUMMARY_MAX, cli


def commands() -> Iterator[tuple[str, click.Command]]:
    for name, command in cli.commands.items():
        yield name, command
        if isinstance(command, click.Group):
            yield from ((f"{name} {inner}", one) for inner, one in command.commands.items())


COMMANDS = dict(commands())


def convoy(*arguments: str) -> Result:
    return CliRunner().invoke(cli, list(arguments), env={"COLUMNS": "80"})


def test_every_command_is_under_one_heading() -> None:
    listed = [name for names in SECTIONS.values() for name in names]
    assert sorted([*listed, *DEPLOYMENT]) == sorted(cli.commands)
    assert len(listed) <= 30
    page = convoy("--help").stdout
    assert all(f"`convoy {name}`" in " ".join(page.split()) for name in DEPLOYMENT)
    assert [line.rstrip(":") for line in page.splitlines() if line.rstrip(":") in SECTIONS] == [
        *SECTIONS
    ]


@pytest.mark.parametrize("name", COMMANDS)
def test_a_summary_is_short_and_whole(name: str) -> None:
    first = (COMMANDS[name].help or "").partition("\n\n")[0]
    assert first.endswith(".")
    assert len(first) <= SUMMARY_MAX
    assert COMMANDS[name].get_short_help_str(SUMMARY_MAX).rstrip(".") == first.rstrip(".")


def test_an_option_has_the_same_values_in_every_command() -> None:
    kinds: dict[str, set[tuple[str, bool]]] = {}
    for command in COMMANDS.values():
        context = click.Context(command)
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                kind = parameter.make_metavar(context), parameter.is_flag
                kinds.setdefault(max(parameter.opts, key=len), set()).add(kind)
    # Rerun and Zenoh have an option of this name; commands with that of Zenoh lack the other.
    assert {name for name, found in kinds.items() if len(found) > 1} == {"--connect"}
    assert {name for name, found in kinds.items() if ("TIME", False) in found} >= {
        "--at", "--for", "--from", "--to", "--wait", "--duration",
    }  # fmt: skip


@pytest.mark.parametrize("option", ["--parent-watch", "--rerun"])
def test_internal_options_are_hidden(option: str) -> None:
    assert not any(option in convoy(*name.split(), "--help").stdout for name in COMMANDS)


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (["run", "--los", "0.1"], ["--los: ", "--loss"]),
        (["run", "--loss", "40"], ["--loss: ", "0.4"]),
        (["run", "--loss", "40%"], ["--loss: ", "0.4"]),
        (["run", "--duration", "1e300"], ["--duration: ", "1e300", "500ms"]),
        (["run", "--duration", "9" * 400], ["--duration: "]),
        (["explain", "x", "--vehicle", "v1", "--at", "1e300"], ["--at: "]),
        (["stall", "v1"], ["--for: missing"]),
        (["link", "v1"], ["RECEIVER: missing"]),
        (["blame", "x", "--figure", "gap"], ["--figure: ", "true_gap_m_min"]),
        (["rnu"], ["rnu"]),
        (["export", "x", "--parquet"], ["--parquet: ", "--format parquet"]),
        (["run", "--seed", "x"], ["--seed: ", "whole number"]),
    ],
)
def test_a_usage_error_is_one_line_with_a_hint(arguments: list[str], facts: list[str]) -> None:
    result = convoy(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    assert all(fact in line for fact in facts)


@pytest.mark.parametrize("command", ["run", "check", "drill", "sweep", "bisect"])
def test_duration_and_loss_are_short_for_settings(command: str) -> None:
    names = {name for one in COMMANDS[command].params for name in one.opts}
    assert {"--duration", "--loss", "--set"} <= names


def test_the_shorthands_override_the_scenario() -> None:
    long = convoy("check", "--json", "--set", "duration_s=12.5", "--set", "links.loss_ratio=0.25")
    short = convoy("check", "--json", "--duration", "12500ms", "--loss", "0.25")
    assert short.exit_code == 0
    assert short.stdout == long.stdout


def test_without_a_command_the_help_is_printed() -> None:
    result = convoy()
    assert result.exit_code == 2
    assert "Study:" in result.stderr
