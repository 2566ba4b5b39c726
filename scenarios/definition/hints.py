"""What an invalid key or value was probably meant to be: the "did you mean" of an error line."""

import re
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from functools import cache
from math import pi
from typing import Any, NamedTuple, TypeGuard, get_args

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
_SPELLINGS = {
    "%": "percent",
    "per cent": "percent",
    "km/h": "kmh",
    "m/s": "mps",
    "m/s2": "mps2",
    "m/s²": "mps2",
}
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
} | {word: f"limits.{row.key}" for word, row in WORDS.items()}
"""Keys by common words."""

_SECOND_KEY = re.compile(r"([^,=]*),\s*([A-Za-z][\w.]*)\s*=(.*)", re.DOTALL)
"""A value that goes on with another key, such as "6,gap_m=12"."""

_READ_AS = {"ratio": "per cent", "mps": "km/h"}
"""Units in which numbers that are too large for a key's unit were probably meant."""

LARGEST = 1e15
"""Larger numbers were not meant to be another unit."""

SAME, IN_TABLE, OF_QUANTITY, LEAST = 1.5, 0.4, 0.4, 1.05
"""Score of a key with the same stem; what its place in the same table adds, and there also a unit
of the given quantity; and the least score of a key that is offered. Another stem scores its
similarity, 0 to 1."""

TABLE_FOR_NUMBER = -0.2
"""What it adds that a number is given for a table."""


def key_hint(location: Location, given: object) -> str:
    """Return what follows "unknown key": a similar key, or the keys allowed there."""
    table, word = location[:-1], str(location[-1])
    own = walk(table)[0]
    stems = {split_key(name)[0] for name in fields_of_table(table)}
    if word in fields_of_table(own) and split_key(word)[0] not in stems:
        kinds = [kind for kind in kinds_of(walk(own)[1]) if word in fields_of_table((*own, kind))]
        return f", allowed only with {dotted_key((*own, 'kind'))} = {either(kinds)}"
    names, value = _leaf(given)
    found = _similar((*own, word, *names), value, walk(table)[1])
    if found is None:
        return f", allowed {', '.join(sorted(fields_of_table(table)))}"
    return f", did you mean {_entry(found, value, split_key((word, *names)[-1])[1])}?"


def value_hint(location: Location, problem: ErrorDetails) -> str:
    """Return ", did you mean …?" for a value of the wrong type or size; empty without a guess."""
    kind, given = problem["type"], problem["input"]
    key = walk(location)[0]
    if isinstance(given, str) and (match := _SECOND_KEY.fullmatch(given)):
        return _hint_for_second_key(key, *match.groups())
    if kind in {"literal_error", "union_tag_invalid"} and isinstance(given, str | Mapping):
        word = str(given.get("kind") if isinstance(given, Mapping) else given)
        guess = closest(word, _words(location, kind), cutoff=0.67)
        return f", did you mean {toml_repr(guess)}?" if guess else ""
    if kind in {"model_type", "model_attributes_type", "dict_type"} and _is_number(given):
        found = _similar(key, given, walk(location[:-1])[1])
        return f", did you mean {_entry(found, given, '')}?" if found else ""
    if kind == "tuple_type" and isinstance(given, Mapping):
        names, value = _leaf(given)
        if key == ("link",) and names and (found := _similar((*key, *names), value, ())):
            return f", did you mean {dotted_key(found.key)}?"
        name = dotted_key(key)
        return f", write [[{name}]] instead of [{name}]" if _has_tables(field_at(location)) else ""
    return _hint_for_number(location, kind, given)


def _hint_for_number(location: Location, kind: str, given: object) -> str:
    """Guess the number from "20ms" or "0,4", from 4.0 of a count, or from 40 of a ratio."""
    unit, number, origin = split_key(str(walk(location)[0][-1]))[1], None, ""
    if isinstance(given, str) and kind.startswith(("int", "float")):
        number = number_in(given, unit)
    elif _is_number(given) and kind.startswith("int"):
        number = float(given)
    elif _is_number(given) and kind.startswith("less_than") and given >= 2 and unit in _READ_AS:
        number = converted(float(given), _SPELLINGS[_READ_AS[unit]], unit)
        origin = f" (for {given:g} {_READ_AS[unit]})"
    if number is None or (kind.startswith("int") and not number.is_integer()):
        return ""
    is_allowed = _is_within(bounds_of(field_at(location)), number)
    return f", did you mean {number:g}{origin}?" if is_allowed else ""


def _hint_for_second_key(key: Location, value: str, second: str, its_value: str) -> str:
    """Offer one `--set` for each key; the second may be in the table of the first."""
    is_inside = second in fields_of_table(key[:-1])
    other = dotted_key((*key[:-1], second)) if is_inside else second
    settings = f"--set {dotted_key(key)}={value.strip()} --set {other}={its_value.strip()}"
    return f", one key for each --set, did you mean {settings}?"


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
    return [word for word in literals_of(field_at(location).annotation) if isinstance(word, str)]


def literals_of(annotation: Any) -> Iterator[Any]:
    for part in get_args(annotation):
        yield from literals_of(part) if get_args(part) else (part,)


def _leaf(given: object) -> tuple[tuple[str, ...], object]:
    """Follow tables with one entry each; returns their keys and the value."""
    names: tuple[str, ...] = ()
    while isinstance(given, Mapping) and len(given) == 1:
        ((name, given),) = given.items()
        names = (*names, str(name))
    return names, given


# ---- The key that is most like what was written, of all keys of a scenario


ANY = "*"
"""Name of a vehicle in a key that is the same for all."""


class _Key(NamedTuple):
    key: Location
    field: FieldInfo


def _entry(found: _Key, given: object, unit: str) -> str:
    """Return the key, with the value where it has to be converted to the key's unit."""
    text, wanted = dotted_key(found.key), split_key(str(found.key[-1]))[1]
    if isinstance(given, str) and wanted:
        number = number_in(given, wanted)
    else:
        number = converted(given, unit or wanted, wanted) if _is_number(given) else None
    if number is None or number == given or not _is_within(bounds_of(found.field), number):
        return text
    return f"{text} = {number:g}"


def _similar(written: Location, value: object, near: Sequence[type[BaseModel]]) -> _Key | None:
    """Return the key with the highest score, first of those in the tables `near` the written key.

    Equal scores go to the first of SECTIONS and to the outer table.
    """
    keys = [
        *_keys_below(tuple(near), written[:-1]),
        *(_Key(_named(one.key, written), one.field) for one in _keys_below((ScenarioTables,))),
    ]
    order = {name: place for place, name in enumerate(SECTIONS)}
    best = max(
        (one for one in keys if ANY not in one.key and one.key != written),
        key=lambda one: (
            _score(one, written, value),
            -order.get(str(one.key[0]), len(order)),
            -len(one.key),
        ),
    )
    return best if _score(best, written, value) >= LEAST else None


def _named(key: Location, written: Location) -> Location:
    """Put the name of a vehicle, if one is written, into the key of a table for each vehicle."""
    if len(written) <= len(key[:-1]):
        return key
    return tuple(
        other if part == ANY else part for part, other in zip(key, (*written, ""), strict=False)
    )


def _score(one: _Key, written: Location, value: object) -> float:
    """Return how much a key is like the written one; 0 if it cannot have the value."""
    word = str(written[-1]).lower().replace("-", "_").strip("_")
    (stem, unit), (own, its_unit) = split_key(word), split_key(str(one.key[-1]))
    is_of_quantity = unit != "" and its_unit != "" and UNITS[unit][0] == UNITS[its_unit][0]
    if unit and not is_of_quantity and not (own == stem and its_unit):  # `lead_mps` is not `lead`
        return 0.0
    is_table = _has_tables(one.field)
    if isinstance(value, Mapping) and not is_table:
        return 0.0
    alias = ALIASES.get(word, ALIASES.get(stem, "")).split(".")
    is_alias = alias[0] == one.key[0] and alias[-1] == one.key[-1]
    if own == stem or (is_alias and written[0] in {alias[0], written[-1]}):
        likeness = SAME
    else:
        likeness = SequenceMatcher(None, stem, own).ratio()
        likeness += 0.25 * (stem.split("_")[0] == own.split("_")[0])
    table, other = (".".join(map(str, key[:-1])).lower() for key in (written, one.key))
    is_in_table = SequenceMatcher(None, table, other).ratio()
    likeness += TABLE_FOR_NUMBER * (is_table and isinstance(value, int | float))
    return likeness + (IN_TABLE + OF_QUANTITY * is_of_quantity) * is_in_table


@cache
def _keys_below(models: tuple[type[BaseModel], ...], table: Location = ()) -> tuple[_Key, ...]:
    """Return all keys of a table and of those in it; tables in a list are left out."""
    result: list[_Key] = []
    for model in models:
        for name, field in model.model_fields.items():
            result.append(_Key((*table, name), field))
            inner = tuple(models_of(field.annotation))
            if "tuple" not in str(field.annotation) and len(table) < 3:
                by_name = (ANY,) if "dict[" in str(field.annotation) else ()
                result += _keys_below(inner, (*table, name, *by_name))
        if others := tuple(models_by_name(model)):
            result += _keys_below(others, (*table, ANY))
    return tuple(result)


def _has_tables(field: FieldInfo) -> bool:
    return any(models_of(field.annotation))
