"""Why a scenario was refused: one line each, with key, what was given, what is allowed."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from scenarios.definition.renamed import new_key, new_value
from scenarios.definition.schema.base_table import NAME_PATTERN
from scenarios.definition.schema.scenario_tables import ScenarioTables

MAX_SHOWN = 60
"""Characters of a refused text or list that are shown; a number is shown whole."""

LONGEST_NUMBER = 10**1000

Location = tuple[str | int, ...]

_ALLOWED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list [...]",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "datetime_type": "a date and time such as 2026-01-01T00:00:00Z",
    "timezone_aware": "a date and time with its zone, such as 2026-01-01T00:00:00Z",
    "finite_number": "a finite number",
    "too_short": "at least one entry",
    "string_too_short": "a text that is not empty",
}


def toml_repr(value: object) -> str:
    """`value` about as a file would write it, cut to a readable length."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, int):  # whole, however long, as far as Python writes it
        return json.dumps(value) if abs(value) < LONGEST_NUMBER else "a number without end"
    text = value.isoformat() if isinstance(value, datetime) else json.dumps(value, default=str)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def dotted_key(location: Sequence[str | int]) -> str:
    """Key of a problem, such as `path.segments[2].length_m`."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a question that offers the known word next to `word`, or nothing."""
    close = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f", did you mean {close[0]}?" if close else ""


def error_lines(error: ValidationError) -> list[tuple[str, str]]:
    """Key and text of every problem that the validation found."""
    problems = error.errors(include_url=False)
    # A list without the entries that are refused can be too short: that is said by those.
    inside = {one["loc"][:depth] for one in problems for depth in range(len(one["loc"]))}
    wrong = [one for one in problems if one["type"] != "too_short" or one["loc"] not in inside]
    return [_refusal(problem) for problem in wrong]


def _refusal(problem: ErrorDetails) -> tuple[str, str]:
    location = problem["loc"]
    key, kind, given = dotted_key(_walk(location)[0]), problem["type"], problem["input"]
    if kind == "extra_forbidden" and (new := _renamed(location, given)):
        return key, f"is now {new}"
    if kind == "extra_forbidden":
        return key, "unknown key" + _suggestion(location)
    if kind == "missing":
        return key, "missing"
    if kind.startswith("union_tag"):
        found = f"given {toml_repr(given['kind'])}" if "kind" in given else "missing"
        return f"{key}.kind", f"{found}, allowed {_either(_kinds(_walk(location)[1]))}"
    return key, f"given {toml_repr(given)}, allowed {_allowed(location, problem)}"


def _renamed(location: Location, given: object) -> str:
    """New name of a key, with its value if that was renamed too; empty if neither was."""
    parts = tuple(map(str, location))
    name = new_key(parts)
    if name is None:
        return ""
    key, value = dotted_key((*_walk(location)[0][:-1], name)), new_value((*parts[:-1], name), given)
    return key if value is None else f"{key} = {toml_repr(value)}"


def _either(words: Sequence[str]) -> str:
    *others, last = map(toml_repr, words)
    return f"{', '.join(others)} or {last}"


def _allowed(location: Location, problem: ErrorDetails) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}:
        return limits(_field(location))
    if kind == "literal_error" and (new := new_value(map(str, location), problem["input"])):
        return f"{toml_repr(new)}, its new name"
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    if kind == "string_pattern_mismatch" and context.get("pattern") == NAME_PATTERN:
        return "up to 32 letters, digits, _ and -, a letter first"
    return _ALLOWED.get(kind, problem["msg"])


def limits(field: FieldInfo) -> str:
    """Put in words the range of a number's key: `0 to 1`, `more than 0, at most 100`."""
    found = {
        name: bound
        for limit in (*field.metadata, *_metadata(field.annotation))
        for name in ("ge", "gt", "le", "lt")
        if (bound := getattr(limit, name, None)) is not None
    }
    if "ge" in found and "le" in found:
        return f"{found['ge']} to {found['le']}"
    words = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    return ", ".join(f"{word} {found[name]}" for name, word in words.items() if name in found)


def _metadata(annotation: Any) -> Iterator[Any]:
    for one in getattr(annotation, "__metadata__", ()):
        yield from one.metadata if isinstance(one, FieldInfo) else (one,)
    for part in get_args(annotation):
        yield from _metadata(part)


def models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_of(part)


def models_by_name(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Tables that a table has under the names of vehicles, beside its own keys."""
    return models_of(table.__annotations__.get("__pydantic_extra__"))


def _walk(location: Location) -> tuple[Location, list[type[BaseModel]]]:
    """Follow a location: its key without tags, and the tables that may be there.

    Pydantic puts the kind of a table between its key and those inside it. Names of vehicles and
    list indices are passed over.
    """
    key: Location = ()
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in location:
        of_kind = [model for model in models if part in _kinds([model])]
        if len(models) > 1 and of_kind:
            models = of_kind
            continue
        key = (*key, part)
        for model in models:
            if part in model.model_fields:
                models = list(models_of(model.model_fields[str(part)].annotation))
                break
        else:
            models = [one for model in models for one in models_by_name(model)] or models
    return key, models


def _kinds(models: Sequence[type[BaseModel]]) -> list[str]:
    return [
        word
        for model in models
        if "kind" in model.model_fields
        for word in get_args(model.model_fields["kind"].annotation)
    ]


def _fields(location: Location) -> dict[str, FieldInfo]:
    _, models = _walk(location)
    return {name: field for model in models for name, field in model.model_fields.items()}


def _field(location: Location) -> FieldInfo:
    """Return the key at a location, or what is said of each entry of a list."""
    if isinstance(location[-1], int):
        return FieldInfo.from_annotation(get_args(_field(location[:-1]).annotation)[0])
    return _fields(location[:-1])[str(location[-1])]


def _suggestion(location: Location) -> str:
    """Guess the key: same word with another unit, near spelling, or another table."""
    table, word = location[:-1], str(location[-1])
    here = list(_fields(table))
    stem = word.split("_", maxsplit=1)[0]
    same_stem = [key for key in here if key.split("_")[0] == stem]
    near_here = get_close_matches(word, same_stem or here, n=1, cutoff=0.4 if same_stem else 0.7)
    if near_here:
        return f", did you mean {dotted_key((*_walk(table)[0], near_here[0]))}?"
    elsewhere = [
        f"{name}.{word}" for name in ScenarioTables.model_fields if word in _fields((name,))
    ]
    if elsewhere:
        return f", did you mean {elsewhere[0]}?"
    return f", allowed {', '.join(sorted(here))}"
