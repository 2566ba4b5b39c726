"""What an invalid key or value was probably meant to be: the "did you mean" of an error line."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from math import pi
from typing import Any, TypeGuard, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from scenarios.definition.schema.limit_rows import WORDS
from scenarios.definition.schema.plug_ins.table import tagged_table
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.wording import closest, dotted_key, either, toml_repr

# ---- Units at the end of keys and of values such as "20ms"


UNITS = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0), "h": ("s", 3600.0),
    "m": ("m", 1.0), "km": ("m", 1000.0), "cm": ("m", 0.01), "mm": ("m", 1e-3),
    "mps": ("mps", 1.0), "kmh": ("mps", 1 / 3.6), "kph": ("mps", 1 / 3.6), "mph": ("mps", 0.44704),
    "ratio": ("ratio", 1.0), "percent": ("ratio", 0.01), "pct": ("ratio", 0.01),
    "hz": ("hz", 1.0), "khz": ("hz", 1000.0),
    "rad": ("rad", 1.0), "deg": ("rad", pi / 180.0),
    "mps2": ("mps2", 1.0), "mps3": ("mps3", 1.0), "kg": ("kg", 1.0), "t": ("kg", 1000.0),
}  # fmt: skip
"""Quantity of a unit, and its factor to the SI unit."""
_SPELLINGS = {"%": "percent", "km/h": "kmh", "m/s": "mps", "m/s2": "mps2", "m/s²": "mps2"}
_NUMBER = re.compile(r"([-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(\S*)")
_QUALIFIERS = ("_max", "_min")


def split_key(key: str) -> tuple[str, str]:
    """Split a key into its stem with the qualifier, and its unit: `error_m_max` is `error_max`."""
    ending = next((word for word in _QUALIFIERS if key.endswith(word)), "")
    stem, _, unit = key.removesuffix(ending).rpartition("_")
    return (f"{stem}{ending}", unit) if stem and unit in UNITS else (key, "")


def converted(value: float, unit: str, wanted: str) -> float | None:
    """Convert a value between units of one quantity, rounded to 6 digits; None between others."""
    if unit == wanted:
        return value
    if unit not in UNITS or wanted not in UNITS or UNITS[unit][0] != UNITS[wanted][0]:
        return None
    return float(f"{value * UNITS[unit][1] / UNITS[wanted][1]:.6g}")


def number_in(text: str, wanted: str) -> float | None:
    """Read a text such as "20ms", "40 %" or "0,4" as a number in the `wanted` unit."""
    match = _NUMBER.fullmatch(text.strip().lstrip("=").strip())
    if match is None:
        return None
    unit = _SPELLINGS.get(match[2].lower(), match[2].lower()) or wanted
    return converted(float(match[1].replace(",", ".")), unit, wanted)


# ---- The fields of the scenario's pydantic models at the location of an error


Location = tuple[str | int, ...]


def models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_of(part)


def models_by_name(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield the models of tables named after vehicles, next to the table's own keys."""
    return models_of(table.__annotations__.get("__pydantic_extra__"))


def walk(location: Location) -> tuple[Location, list[type[BaseModel]]]:
    """Follow a location; returns its key without union tags, and the models there.

    The kind of a table, or the tag of a plug-in, is between its key and those inside it. Names of
    vehicles and list indices are skipped.
    """
    key: Location = ()
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in location:
        if (table := tagged_table(part)) is not None:
            models = [table]
            continue
        of_kind = [model for model in models if part in kinds_of([model])]
        if len(models) > 1 and of_kind:
            models = of_kind
            continue
        key = (*key, part)
        for model in models:
            if part in model.model_fields:
                models = list(models_of(model.model_fields[str(part)].annotation))
                break
        else:
            models = [other for model in models for other in models_by_name(model)] or models
    return key, models


def kinds_of(models: Sequence[type[BaseModel]]) -> list[str]:
    return [
        word
        for model in models
        if "kind" in model.model_fields
        for word in get_args(model.model_fields["kind"].annotation)
    ]


def fields_of_table(location: Location) -> dict[str, FieldInfo]:
    """Return the keys that the table at a location may have, of all kinds that it may be."""
    _, models = walk(location)
    return {name: field for model in models for name, field in model.model_fields.items()}


def field_at(location: Location) -> FieldInfo:
    """Return the field at a location; for an entry of a list, the type of its entries."""
    if isinstance(location[-1], int):
        return FieldInfo.from_annotation(get_args(field_at(location[:-1]).annotation)[0])
    return fields_of_table(location[:-1])[str(location[-1])]


def bounds_of(field: FieldInfo) -> dict[str, Any]:
    """Return the bounds of a number by operator: ge, gt, le, lt."""
    return {
        name: bound
        for limit in (*field.metadata, *_metadata(field.annotation))
        for name in ("ge", "gt", "le", "lt")
        if (bound := getattr(limit, name, None)) is not None
    }


def _metadata(annotation: Any) -> Iterator[Any]:
    for item in getattr(annotation, "__metadata__", ()):
        yield from item.metadata if isinstance(item, FieldInfo) else (item,)
    for part in get_args(annotation):
        yield from _metadata(part)


# ---- Hints


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
