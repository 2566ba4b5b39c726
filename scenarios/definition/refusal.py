"""Why a scenario was refused: one line each, with key, what was given, what is allowed."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from difflib import get_close_matches
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from scenarios.definition.schema.table import NAME_PATTERN
from scenarios.definition.schema.tables import ScenarioTables

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


def shown(value: object) -> str:
    """`value` about as a file would write it, cut to a readable length."""
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, int):  # whole, however long, as far as Python writes it
        return json.dumps(value) if abs(value) < LONGEST_NUMBER else "a number without end"
    text = value.isoformat() if isinstance(value, datetime) else json.dumps(value, default=str)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def dotted(location: Sequence[str | int]) -> str:
    """Key of a problem, such as `path.segments[2].length_m`."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def near(word: str, known: Iterable[str]) -> str:
    """Return a question that offers the known word next to `word`, or nothing."""
    close = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f", did you mean {close[0]}?" if close else ""


def refusals(error: ValidationError) -> list[tuple[str, str]]:
    """Key and text of every problem that the validation found.

    Of a list with a bad entry pydantic also says that it is too short, not counting that one.
    """
    problems = error.errors(include_url=False)
    return [_refusal(one) for one in problems if one["type"] != "too_short" or not one["input"]]


def _refusal(problem: ErrorDetails) -> tuple[str, str]:
    location, _ = _walked(problem["loc"])
    key, kind, given = dotted(location), problem["type"], problem["input"]
    if kind == "extra_forbidden":
        _, tables = _walked(problem["loc"][:-1])
        return key, "unknown key" + _suggestion(location, tables)
    if kind == "missing":
        return key, "missing"
    if kind.startswith("union_tag"):
        *others, last = [shown(tag) for tag in _tags(location)]
        found = f"given {shown(given['kind'])}" if "kind" in given else "missing"
        return f"{key}.kind", f"{found}, allowed {', '.join(others)} or {last}"
    return key, f"given {shown(given)}, allowed {_allowed(location, problem)}"


def _walked(location: Location) -> tuple[Location, list[type[BaseModel]]]:
    """Leave out what pydantic puts between a table of several kinds and its key: the kind.

    Returns the tables, too, that there may be at `location`.
    """
    found: list[str | int] = []
    models: list[type[BaseModel]] = [ScenarioTables]
    tagged = False
    for part in location:
        tagged = not tagged and any(part in _kinds(model) for model in models)
        if tagged:
            models = [model for model in models if part in _kinds(model)]
        else:
            found.append(part)
            models = _below(models, part)
    return tuple(found), models


def _kinds(model: type[BaseModel]) -> tuple[str, ...]:
    """Words that stand for a table of several kinds; none for one that has no kind."""
    field = model.model_fields.get("kind")
    return get_args(field.annotation) if field is not None else ()


def _tags(location: Location) -> list[str]:
    """Every kind that the table at `location` may be of."""
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in location:
        models = _below(models, part)
    return [kind for model in models for kind in _kinds(model)]


def _below(models: list[type[BaseModel]], part: str | int) -> list[type[BaseModel]]:
    """Tables that the value of a key may be; names of vehicles and list indices change nothing."""
    for model in models:
        if part in model.model_fields:
            return list(models_of(model.model_fields[str(part)].annotation))
    return models


def _allowed(location: Location, problem: ErrorDetails) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}:
        return limits(_field(location))
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    if kind == "string_pattern_mismatch" and context.get("pattern") == NAME_PATTERN:
        return "up to 32 letters, digits, _ and -, a letter first"
    return _ALLOWED.get(kind, problem["msg"])


def limits(field: FieldInfo) -> str:
    """Put in words the range of a number's key: `0 to 1`, `more than 0, at most 100`."""
    found = {
        name: bound
        for limit in field.metadata
        for name in ("ge", "gt", "le", "lt")
        if (bound := getattr(limit, name, None)) is not None
    }
    if "ge" in found and "le" in found:
        return f"{found['ge']} to {found['le']}"
    words = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    return ", ".join(f"{word} {found[name]}" for name, word in words.items() if name in found)


def models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    """Tables inside the type of a key, such as a list of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_of(part)


def _fields(location: Location) -> dict[str, FieldInfo]:
    """Keys of the table at `location`; names of vehicles and list indices are passed over."""
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in location:
        models = _below(models, part)
    return {name: field for model in models for name, field in model.model_fields.items()}


def _field(location: Location) -> FieldInfo:
    return _fields(location[:-1])[str(location[-1])]


def _suggestion(location: Location, tables: Sequence[type[BaseModel]]) -> str:
    """Guess the key: same word with another unit, near spelling, or another table."""
    table, word = location[:-1], str(location[-1])
    here = [name for model in tables for name in model.model_fields]
    stem = word.split("_", maxsplit=1)[0]
    same_stem = [key for key in here if key.split("_")[0] == stem]
    near_here = get_close_matches(word, same_stem or here, n=1, cutoff=0.4 if same_stem else 0.7)
    if near_here:
        return f", did you mean {dotted((*table, near_here[0]))}?"
    elsewhere = [
        f"{name}.{word}" for name in ScenarioTables.model_fields if word in _fields((name,))
    ]
    if elsewhere:
        return f", did you mean {elsewhere[0]}?"
    return f", allowed {', '.join(sorted(here))}"
