"""Shell completion of scenarios, keys of `--set`, vehicles and viewers.

Click generates the scripts for bash, zsh and fish. Each press of Tab starts a process, so imports
are lazy.
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

    from scenarios.definition.schema.scenario_tables import ScenarioTables

RERUN = ("off", "spawn", "serve", "connect=", "save=")
DEFAULT = "lane_change"
"""Scenario in which a channel preset is shown."""
OWN_FILES = (".toml", ".csv", ".geojson", ".gpx", ".kml", ".mcap", ".nmea", ".pos")
"""Suffixes of scenarios and recorded drives."""
CONVOY_TABLES = ("convoy", "information_flow", "speed", "vehicle")
"""Tables that determine the vehicles and their links."""
ANY_PATH = {"name": "any", "path": {"kind": "segments", "segments": [{"length_m": 1.0}]}}
FILES_ONLY = {"extends", "overrides"}
"""Keys that `--set` does not accept."""


@add_completion_class
class BashWithEquals(BashComplete):
    """Completion in Bash, which splits `links.loss_ratio=0` into three words."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the words before the current word, and the whole current word."""
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
        incomplete = value if equals and option.startswith("-") else incomplete
        there = incomplete[: incomplete.rfind("=") + 1]
        for item in found:
            item.value = item.value.removeprefix(there)
        return found


def scenarios(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    return _names_or_files(library(), incomplete)


def drills(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.library import drills as shipped

    return _names_or_files(shipped(), incomplete)


def channels(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.library import library

    return _names_or_files([*_presets(), *library()], incomplete)


def _names_or_files(shipped: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """Offer shipped names and files in the working folder, or the shell's files."""
    own = sorted(path.name for path in Path().iterdir() if path.suffix.lower() in OWN_FILES)
    known = [*shipped, *own]
    return _matching(known, incomplete) or [CompletionItem(incomplete, type="file")]


def links(context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.topology import directed_links

    convoy = _convoy(context)
    pairs = directed_links(convoy) if convoy else ()
    return _matching([f"{sender}:{receiver}" for sender, receiver in pairs], incomplete)


def _presets() -> list[str]:
    from scenarios.definition.channel.presets import presets

    return [*presets()]


def rerun(_context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    return _matching(RERUN, incomplete)


def vehicles(context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    return _matching(_vehicles(context), incomplete)


def limits(context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    from scenarios.definition.schema.limit_rows import WORDS

    words = [word if row.event else f"{word}=" for word, row in WORDS.items()]
    of_one = [f"{vehicle}.{word}" for vehicle in _vehicles(context) for word in words]
    return _matching([*words, *of_one], incomplete)


def settings(context: Context, _parameter: Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the keys of a scenario, or the values of a complete key."""
    keys = {f"{key}=": values for key, values in _keys(_vehicles(context)).items()}
    left = [key for key in keys if key.startswith(incomplete) or incomplete.startswith(key)]
    whole = [f"{left[0]}{value}" for value in keys[left[0]]] if len(left) == 1 else []
    return _matching(whole or left, incomplete)


def _matching(known: Iterable[str], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(one) for one in known if one.startswith(incomplete)]


def _vehicles(context: Context) -> tuple[str, ...]:
    """Names of the vehicles, or none if the scenario cannot be read."""
    convoy = _convoy(context)
    return convoy.convoy.vehicle_names if convoy else ()


def _convoy(context: Context) -> "ScenarioTables | None":
    """Vehicles and information flow on any path; None if the scenario cannot be read."""
    from scenarios.definition.errors import ScenarioError
    from scenarios.definition.extends import merged
    from scenarios.definition.library import read_file
    from scenarios.definition.schema.scenario_tables import ScenarioTables

    # Click leaves the arguments in place after an option without its value, as here.
    file = next(iter(context.args), context.params.get("scenario") or DEFAULT)
    file = DEFAULT if file in _presets() else file
    try:
        given = merged(read_file(file), context.params.get("overrides") or ())
        kept = {key: given.raw[key] for key in CONVOY_TABLES if key in given.raw}
        return ScenarioTables.model_validate(ANY_PATH | kept)
    except (ScenarioError, ValueError):
        return None


def _keys(vehicles: Sequence[str]) -> dict[str, list[str]]:
    from scenarios.definition.schema.scenario_tables import ScenarioTables

    found: dict[str, list[str]] = {}
    for key, values in _keys_of(ScenarioTables, "", vehicles):  # in tables of several kinds
        found[key] = [*dict.fromkeys((*found.get(key, []), *values))]
    return {key: values for key, values in found.items() if key not in FILES_ONLY}


def _keys_of(
    table: "type[BaseModel]", inside: str, vehicles: Sequence[str]
) -> Iterator[tuple[str, list[str]]]:
    from scenarios.definition.schema.flow_table import WORDS, SourcesTable
    from scenarios.definition.schema.plug_ins.table import PlugInTable
    from scenarios.definition.validation.model_fields import models_by_name, models_of

    for inner in models_by_name(table):
        for vehicle in vehicles:
            yield from _keys_of(inner, f"{inside}{vehicle}.", vehicles)
    for name, field in table.model_fields.items():
        kind, tables = str(field.annotation), list(models_of(field.annotation))
        if not tables or tables == [PlugInTable]:
            yield f"{inside}{name}", _values(name, field)
            continue
        if tables == [SourcesTable]:
            yield f"{inside}{name}", list(WORDS)
        # Offer the first table of a list; tables of vehicles are keyed by name.
        places = [".0"] if "tuple" in kind else [""]
        if kind.startswith("dict"):
            places = [f".{vehicle}" for vehicle in vehicles]
        for place in places:
            for inner in tables:
                yield from _keys_of(inner, f"{inside}{name}{place}.", vehicles)


def _values(name: str, field: "FieldInfo") -> list[str]:
    from scenarios.definition.schema.plug_ins.points import POINTS

    parts = (field.annotation, *get_args(field.annotation))
    words = [word for part in parts for word in get_args(part) if isinstance(word, str)]
    if point := next((one for one in POINTS if one.key.endswith(f".{name}")), None):
        words = list(point.shipped)
    if name == "preset":
        words = _presets()
    if isinstance(field.default, bool):
        words = ["true", "false"]
    elif isinstance(field.default, int | float):
        words = [str(field.default)]
    return words or [""]
