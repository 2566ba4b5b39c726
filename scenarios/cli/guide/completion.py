"""Shell completion of scenarios, keys of `--set`, vehicles and viewers.

Click makes the scripts for bash, zsh and fish. Each press of Tab starts a process, so imports are
lazy.
"""

from collections.abc import Iterable, Iterator, Sequence
from os import environ
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from click import Context, Parameter
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    add_completion_class,
    split_arg_string,
)

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

RERUN = ("off", "spawn", "serve", "connect=", "save=")
DEFAULT = "lane_change"
"""The scenario that shows a shipped channel."""
FILES_ONLY = {"extends", "overrides"}
"""Keys that `--set` does not accept."""


@add_completion_class
class BashWithEquals(BashComplete):
    """Bash splits `links.loss_ratio=0` into three words and completes the last one."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words before the current one, and that one whole."""
        place = int(environ["COMP_CWORD"])
        words = split_arg_string(environ["COMP_WORDS"])[: place + 1]
        words += [""] * (place + 1 - len(words))
        whole: list[str] = []
        for word in words:
            if whole and (word == "=" or whole[-1].endswith("=")):
                whole[-1] += word
            else:
                whole.append(word)
        return whole[1:-1], whole[-1]

    def get_completions(self, args: list[str], incomplete: str) -> list[CompletionItem]:
        """Return replacements of the last word, without the part before its last `=`."""
        found = super().get_completions(args, incomplete)
        option, equals, value = incomplete.partition("=")
        begun = value if equals and option.startswith("-") else incomplete
        there = begun[: begun.rfind("=") + 1]
        for item in found:
            item.value = item.value.removeprefix(there)
        return found


def scenarios(_context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    return _names_or_files(library(), begun)


def drills(_context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    from scenarios.definition.library import drills as shipped

    return _names_or_files(shipped(), begun)


def channels(_context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    return _names_or_files([*_presets(), *library()], begun)


def _names_or_files(shipped: Iterable[str], begun: str) -> list[CompletionItem]:
    """Offer shipped names and the TOML files here; elsewhere the shell's own files."""
    known = [*shipped, *sorted(path.name for path in Path().glob("*.toml"))]
    return _matching(known, begun) or [CompletionItem(begun, type="file")]


def links(context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    from scenarios.definition.topology import directed_links

    pairs = directed_links(_vehicles(context))
    return _matching([f"{sender}:{receiver}" for sender, receiver in pairs], begun)


def _presets() -> list[str]:
    from scenarios.definition.channel.presets import presets

    return [*presets()]


def rerun(_context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    return _matching(RERUN, begun)


def vehicles(context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    return _matching(_vehicles(context), begun)


def limits(context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    from scenarios.definition.schema.limit_rows import WORDS

    words = [word if row.event else f"{word}=" for word, row in WORDS.items()]
    of_one = [f"{vehicle}.{word}" for vehicle in _vehicles(context) for word in words]
    return _matching([*words, *of_one], begun)


def settings(context: Context, _parameter: Parameter, begun: str) -> list[CompletionItem]:
    """Offer the keys of a scenario, or the values of a complete key."""
    keys = {f"{key}=": values for key, values in _keys(_vehicles(context)).items()}
    left = [key for key in keys if key.startswith(begun) or begun.startswith(key)]
    whole = [f"{left[0]}{value}" for value in keys[left[0]]] if len(left) == 1 else []
    return _matching(whole or left, begun)


def _matching(known: Iterable[str], begun: str) -> list[CompletionItem]:
    return [CompletionItem(one) for one in known if one.startswith(begun)]


def _vehicles(context: Context) -> tuple[str, ...]:
    """Names of the vehicles, as far as file and overrides can be read; else none."""
    from scenarios.definition.errors import ScenarioError
    from scenarios.definition.extends import merged
    from scenarios.definition.library import read_file
    from scenarios.definition.schema.scenario_tables import ConvoyTable

    # Click leaves the arguments in place after an option without its value, as here.
    file = next(iter(context.args), context.params.get("scenario") or DEFAULT)
    file = DEFAULT if file in _presets() else file
    try:
        given = merged(read_file(file), context.params.get("overrides") or ())
        return ConvoyTable.model_validate(given.raw.get("convoy", {})).vehicle_names
    except (ScenarioError, ValueError):
        return ()


def _keys(vehicles: Sequence[str]) -> dict[str, list[str]]:
    from scenarios.definition.schema.scenario_tables import ScenarioTables

    found: dict[str, list[str]] = {}
    for key, values in _keys_of(ScenarioTables, "", vehicles):  # some are in tables of many kinds
        found[key] = [*dict.fromkeys((*found.get(key, []), *values))]
    return {key: values for key, values in found.items() if key not in FILES_ONLY}


def _keys_of(
    table: "type[BaseModel]", inside: str, vehicles: Sequence[str]
) -> Iterator[tuple[str, list[str]]]:
    from scenarios.definition.validation.model_fields import models_by_name, models_of

    for inner in models_by_name(table):
        for vehicle in vehicles:
            yield from _keys_of(inner, f"{inside}{vehicle}.", vehicles)
    for name, field in table.model_fields.items():
        kind, tables = str(field.annotation), list(models_of(field.annotation))
        if not tables:
            yield f"{inside}{name}", _values(name, field)
            continue
        # A list of tables is begun with its first one; vehicles' tables are by name.
        places = [".0"] if "tuple" in kind else [""]
        if kind.startswith("dict"):
            places = [f".{vehicle}" for vehicle in vehicles]
        for place in places:
            for inner in tables:
                yield from _keys_of(inner, f"{inside}{name}{place}.", vehicles)


def _values(name: str, field: "FieldInfo") -> list[str]:
    from scenarios.definition.schema.scenario_tables import CONTROLLERS

    parts = (field.annotation, *get_args(field.annotation))
    words = [word for part in parts for word in get_args(part) if isinstance(word, str)]
    if name == "controller":
        words = list(CONTROLLERS)
    if name == "preset":
        words = _presets()
    if isinstance(field.default, bool):
        words = ["true", "false"]
    elif isinstance(field.default, int | float):
        words = [str(field.default)]
    return words or [""]
