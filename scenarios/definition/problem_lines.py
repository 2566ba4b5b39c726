"""Pydantic errors as lines: the key, the given value, what is allowed, and a hint."""

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from scenarios.definition.hints import (
    Location,
    bounds_of,
    field_at,
    key_hint,
    kinds_of,
    value_hint,
    walk,
)
from scenarios.definition.schema.link_tables import WORD_ERROR
from scenarios.definition.schema.plug_ins.table import ERROR_TYPE
from scenarios.definition.schema.settings_table import NAME_PATTERN
from scenarios.definition.wording import did_you_mean, dotted_key, either, toml_repr

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


def error_lines(error: ValidationError) -> list[tuple[str, str]]:
    """Return key and text of every problem that the validation reports."""
    problems = error.errors(include_url=False)
    # A list is too short without its invalid entries, which are reported themselves.
    inside = {one["loc"][:depth] for one in problems for depth in range(len(one["loc"]))}
    wrong = [one for one in problems if one["type"] != "too_short" or one["loc"] not in inside]
    return [_line(problem) for problem in wrong]


def _line(problem: ErrorDetails) -> tuple[str, str]:
    location, kind, given = problem["loc"], problem["type"], problem["input"]
    key = dotted_key(walk(location)[0])
    if kind == "extra_forbidden":
        return key, f"unknown key{key_hint(location, given)}"
    if kind == "missing":
        return key, "missing"
    if kind in {WORD_ERROR, ERROR_TYPE}:
        describe = _word_problem if kind == WORD_ERROR else _class_problem
        return key, describe(problem.get("ctx", {}), given)
    if kind.startswith("union_tag"):
        allowed = either(kinds_of(walk(location)[1]))
        if "kind" not in given:
            return f"{key}.kind", f"missing, allowed {allowed}"
        hint = value_hint(location, problem)
        return f"{key}.kind", f"given {toml_repr(given['kind'])}, allowed {allowed}{hint}"
    allowed = _allowed(location, problem)
    return key, f"given {toml_repr(given)}, allowed {allowed}{value_hint(location, problem)}"


def _word_problem(context: Mapping[str, Any], given: object) -> str:
    """Describe a value that is neither one of the words nor anything else allowed."""
    words = context["words"]
    hint = did_you_mean(given, words) if isinstance(given, str) else ""
    allowed = ", ".join(map(toml_repr, words))
    return f"given {toml_repr(given)}, allowed {allowed}, {context['or_else']}{hint}"


def _class_problem(context: Mapping[str, Any], _given: object) -> str:
    """Describe what is wrong with a class; an unknown name is followed by the shipped ones."""
    if "use" not in context:
        return str(context["text"])
    use, names = str(context["use"]), context["names"]
    text = f"given {toml_repr(use)}" if use and "." not in use else context["text"]
    allowed = f"{', '.join(map(toml_repr, names))}, or " if names else ""
    return f"{text}, allowed {allowed}your own package.module.name{did_you_mean(use, names)}"


def _allowed(location: Location, problem: ErrorDetails) -> str:
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}:
        return _range(bounds_of(field_at(location)))
    if kind == "literal_error":
        return str(context["expected"]).replace("'", '"')
    if kind == "string_pattern_mismatch" and context.get("pattern") == NAME_PATTERN:
        return "up to 32 letters, digits, _ and -, a letter first"
    return _ALLOWED.get(kind, problem["msg"])


def _range(bounds: dict[str, object]) -> str:
    """Describe bounds: `0 to 1`, `more than 0, at most 100`."""
    if "ge" in bounds and "le" in bounds:
        return f"{bounds['ge']} to {bounds['le']}"
    words = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}
    return ", ".join(f"{word} {bounds[name]}" for name, word in words.items() if name in bounds)
