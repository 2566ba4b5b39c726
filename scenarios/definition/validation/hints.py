"""What an invalid key or value was probably meant to be: the "did you mean" of an error line."""

import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import Any, TypeGuard, get_args

from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from scenarios.definition.schema.limit_rows import WORDS
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.validation.model_fields import (
    Location,
    bounds_of,
    field_at,
    fields_of_table,
    kinds_of,
    models_of,
    walk,
)
from scenarios.definition.validation.units import UNITS, converted, number_in, split_key
from scenarios.definition.validation.wording import closest, dotted_key, either, toml_repr

SECTIONS = ("convoy", "links", "control", "speed", "gnss", "path")
"""Tables in which a key without its table is looked for first."""

ALIASES = {
    "speed": "speed.set_mps",
    "velocity": "speed.set_mps",
    "gap": "convoy.gap_m",
    "spacing": "convoy.gap_m",
    "cars": "convoy.vehicles",
    "loss": "links.loss_ratio",
    "packet_loss": "links.loss_ratio",
    "latency": "links.latency_ms",
    "delay": "links.latency_ms",
    "friction": "parameters.friction_ratio",
    "duration": "duration_s",
}
"""Keys by common words."""

_SECOND_KEY = re.compile(r"([^,=]*),\s*([A-Za-z][\w.]*)\s*=(.*)", re.DOTALL)
"""A value that goes on with another key, such as "6,gap_m=12"."""

_READ_AS = {"ratio": "per cent", "mps": "km/h"}
"""Units in which numbers that are too large for a key's unit were probably meant."""

LARGEST = 1e15
"""Larger numbers were not meant to be another unit."""


def key_hint(location: Location, given: object) -> str:
    """Return what follows "unknown key": a similar key, or the keys allowed there."""
    table, word = location[:-1], str(location[-1])
    similar = _same_stem(fields_of_table(table), split_key(word)[0])
    if word in fields_of_table(walk(table)[0]) and not similar:
        kinds = [kind for kind in _kinds_at(table) if word in _fields_of_kind(table, kind)]
        kind_key = dotted_key((*walk(table)[0], "kind"))
        return f", allowed only with {kind_key} = {either(kinds)}"
    names, value = _leaf(given)
    key = _corrected(table, (word, *names), value)
    if key is None:
        return f", allowed {', '.join(sorted(fields_of_table(table)))}"
    return f", did you mean {_entry(key, value, split_key((word, *names)[-1])[1])}?"


def value_hint(location: Location, problem: ErrorDetails) -> str:
    """Return ", did you mean …?" for a value of the wrong type or size; empty without a guess."""
    kind, given = problem["type"], problem["input"]
    key = walk(location)[0]
    if isinstance(given, str) and (match := _SECOND_KEY.fullmatch(given)):
        return _hint_for_second_key(key, *match.groups())
    if kind in {"literal_error", "union_tag_invalid"} and isinstance(given, str | Mapping):
        word = str(given.get("kind") if isinstance(given, Mapping) else given)
        words = _words(location, kind)
        guess = closest(word, words, cutoff=0.67)
        return f", did you mean {toml_repr(guess)}?" if guess else ""
    if kind in {"model_type", "model_attributes_type", "dict_type"} and _is_number(given):
        return _hint_for_number_in_place_of_table(location, given)
    if kind == "tuple_type" and isinstance(given, Mapping):
        return _hint_for_table_in_place_of_list(location, given)
    return _hint_for_number(location, kind, given)


def _hint_for_number(location: Location, kind: str, given: object) -> str:
    """Return the number that was probably meant in the unit of the key; empty without a guess."""
    unit = split_key(str(walk(location)[0][-1]))[1]
    number = _intended_number(unit, given, kind)
    if number is None or not _is_within(bounds_of(field_at(location)), number):
        return ""
    if _is_number(given) and unit in _READ_AS:
        return f", did you mean {number:g} (for {given:g} {_READ_AS[unit]})?"
    return f", did you mean {number:g}?"


def _hint_for_second_key(key: Location, value: str, second: str, its_value: str) -> str:
    """Offer one `--set` for each key; the second may be in the table of the first."""
    is_inside = second in fields_of_table(key[:-1])
    other = dotted_key((*key[:-1], second)) if is_inside else second
    settings = f"--set {dotted_key(key)}={value.strip()} --set {other}={its_value.strip()}"
    return f", one key for each --set, did you mean {settings}?"


def _hint_for_table_in_place_of_list(location: Location, given: Mapping[str, object]) -> str:
    """Offer `links.loss_ratio` for `link.loss_ratio`, and `[[link]]` for `[link]`."""
    key = walk(location)[0]
    names, value = _leaf(given)
    if key == ("link",) and names and (meant := _corrected(("links",), names, value)):
        return f", did you mean {dotted_key(meant)}?"
    name = dotted_key(key)
    return f", write [[{name}]] instead of [{name}]" if _has_tables(field_at(location)) else ""


def _intended_number(unit: str, given: object, kind: str) -> float | None:
    """Guess the number from "20ms" or "0,4", from 4.0 of a count, or from 40 of a ratio."""
    if isinstance(given, str) and (kind.startswith(("int", "float"))):
        number = number_in(given, unit)
        is_fraction = number is not None and not number.is_integer()
        return None if is_fraction and kind.startswith("int") else number
    if not _is_number(given):
        return None
    if kind.startswith("int") and float(given).is_integer():
        return float(given)
    if kind.startswith("less_than") and given >= 2:
        return {"ratio": given / 100.0, "mps": float(f"{given / 3.6:.3g}")}.get(unit)
    return None


def _is_number(value: object) -> TypeGuard[int | float]:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return abs(value) < LARGEST


def _is_within(bounds: Mapping[str, Any], number: float) -> bool:
    try:
        return (
            bounds.get("ge", number) <= number <= bounds.get("le", number)
            and not number <= bounds.get("gt", number - 1)
            and not number >= bounds.get("lt", number + 1)
        )
    except TypeError:  # bounds of a date
        return False


def _words(location: Location, kind: str) -> list[str]:
    if kind == "union_tag_invalid":
        return kinds_of(walk(location)[1])
    return [word for word in _literals(field_at(location).annotation) if isinstance(word, str)]


def _literals(annotation: Any) -> Iterator[Any]:
    for part in get_args(annotation):
        yield from _literals(part) if get_args(part) else (part,)


def _hint_for_number_in_place_of_table(location: Location, given: object) -> str:
    """Offer `links.loss_ratio` for `links.loss`, and `speed.set_mps` for `speed`."""
    key = walk(location)[0]
    word = str(key[-1])
    same_stem = _same_stem(_scalars(key[:-1]), word)
    meant = (*key[:-1], same_stem[0]) if same_stem else _alias(key[:-1], word)
    return f", did you mean {_entry(meant, given, '')}?" if meant else ""


def _entry(key: Location, given: object, unit: str) -> str:
    """Return the key, with the value where it has to be converted to the key's unit."""
    text, wanted = dotted_key(key), split_key(str(key[-1]))[1]
    if isinstance(given, str) and wanted:
        number = number_in(given, wanted)
    else:
        number = converted(given, unit or wanted, wanted) if _is_number(given) else None
    if number is None or number == given or not _is_within(bounds_of(_field(key)), number):
        return text
    return f"{text} = {number:g}"


def _leaf(given: object) -> tuple[tuple[str, ...], object]:
    """Follow tables with one entry each; returns their keys and the value."""
    names: tuple[str, ...] = ()
    while isinstance(given, Mapping) and len(given) == 1:
        ((name, given),) = given.items()
        names = (*names, str(name))
    return names, given


def _corrected(table: Location, names: tuple[str, ...], value: object) -> Location | None:
    """Correct the first name in a table, then those inside it; None if one is like no key."""
    name, *rest = names
    result = _similar(table, name, is_table=bool(rest) or isinstance(value, Mapping))
    if result is None or not rest:
        return result
    if result == ("vehicle",):
        result, rest = (*result, rest[0]), rest[1:]
        return _corrected(result, tuple(rest), value) if rest else result
    if rest[0] in fields_of_table(result):
        inner = (*result, rest[0])
        return _corrected(inner, tuple(rest[1:]), value) if rest[1:] else inner
    return _corrected(result, tuple(rest), value)


def _similar(table: Location, word: str, *, is_table: bool) -> Location | None:
    """Find the key for a word: another spelling or unit, a common word, or in another table."""
    here, plain = fields_of_table(table), word.lower().replace("-", "_").strip("_")
    own = walk(table)[0]
    if plain in here:
        return (*own, plain)
    stem, unit = split_key(plain)
    known = list(here) if is_table else _scalars(table)
    # A word with a unit is not meant to be a key without one: `lead_mps` is not `lead`.
    same_stem = [key for key in _same_stem(known, stem) if split_key(key)[1] or not unit]
    if same_stem:
        return (*own, closest(plain, same_stem, cutoff=0.0) or same_stem[0])
    if own[:1] == ("limits",) and plain in WORDS:
        return (*own, WORDS[plain].key)
    if not is_table and (alias := _alias(own, stem)):
        return alias
    if not is_table and not own and (elsewhere := _elsewhere(plain, stem)):
        return elsewhere
    first_word = [key for key in known if key.split("_")[0] == stem.split("_", maxsplit=1)[0]]
    of_unit = [key for key in known if unit and _same_quantity(split_key(key)[1], unit)]
    guess = (
        closest(plain, set(first_word) & set(of_unit), cutoff=0.4)
        or (closest(plain, of_unit, cutoff=0.0) if first_word else None)
        or closest(plain, first_word, cutoff=0.4)
        or closest(plain, here, cutoff=0.7)
    )
    return (*own, guess) if guess else _elsewhere(plain, stem)


def _same_stem(keys: Iterable[str], stem: str) -> list[str]:
    return [key for key in keys if split_key(key)[0] == stem]


def _same_quantity(unit: str, other: str) -> bool:
    return unit in UNITS and other in UNITS and UNITS[unit][0] == UNITS[other][0]


def _alias(table: Location, stem: str) -> Location | None:
    """Return the key of a common word, if it is inside the table in question."""
    key: Location = tuple(ALIASES[stem].split(".")) if stem in ALIASES else ()
    return key if key and key[: len(table)] == table else None


def _elsewhere(word: str, stem: str) -> Location | None:
    """Find a key in another table by its name, or by its stem."""
    for matches in (lambda key: key == word, lambda key: split_key(key)[0] == stem):
        for section in (*SECTIONS, *ScenarioTables.model_fields):
            for key in _keys_below(section):
                if matches(str(key[-1])):
                    return key
    return None


@cache
def _keys_below(section: str) -> tuple[Location, ...]:
    """Return all keys of a top-level table, the outer ones first; lists are left out."""
    result: list[Location] = []
    tables: list[Location] = [(section,)]
    while tables:
        table = tables.pop(0)
        for name, field in fields_of_table(table).items():
            if _is_list(field):
                continue
            result.append((*table, name))
            if any(models_of(field.annotation)) and len(table) < 3:
                tables.append((*table, name))
    return tuple(result)


def _scalars(table: Location) -> list[str]:
    return [name for name, field in fields_of_table(table).items() if not _has_tables(field)]


def _has_tables(field: FieldInfo) -> bool:
    return any(models_of(field.annotation))


def _is_list(field: FieldInfo) -> bool:
    return "tuple" in str(field.annotation)


def _field(key: Location) -> FieldInfo:
    return fields_of_table(key[:-1])[str(key[-1])]


def _kinds_at(table: Location) -> list[str]:
    return kinds_of(walk(walk(table)[0])[1])


def _fields_of_kind(table: Location, kind: str) -> dict[str, FieldInfo]:
    return fields_of_table((*walk(table)[0], kind))
