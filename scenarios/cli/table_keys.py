"""Keys of a scenario's tables: ranges, defaults and documentation, from the classes that rule."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from inspect import cleandoc
from textwrap import fill
from types import NoneType
from typing import Any, Literal, get_args, get_origin

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from scenarios.cli.output import grid_of
from scenarios.definition.hints import bounds_of, models_of
from scenarios.definition.schema.link_tables import WORDS, SourcesTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import SettingsTable

# ---- Texts and rows at the width of a terminal


WIDTH = 80
Row = tuple[str, ...]


def print_text(text: str) -> None:
    paragraphs = cleandoc(text).split("\n\n")
    click.echo("\n\n".join(one if "   " in one else fill(one, WIDTH) for one in paragraphs))


def print_rows(rows: Iterable[Row]) -> None:
    from rich.console import Console

    Console().print(grid_of(rows))


def print_section(heading: str, rows: Iterable[Row], text: str = "") -> None:
    from rich.console import Console

    console = Console()
    click.echo()
    console.print(heading, style="bold", highlight=False, markup=False)
    table = grid_of(rows)
    if text:
        print_text(text)
    if text and table.row_count:
        click.echo()
    if table.row_count:
        console.print(table)


# ---- Table keys


KEY_LINE = re.compile(r"^(\w+(?:, \w+)*) {2,}(\S.*)$")
KINDS = "table; its `kind` selects the form"
BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


@dataclass(frozen=True, slots=True)
class TableDoc:
    place: str
    model: type[BaseModel]
    text: str
    keys: Mapping[str, str]


def models_at(key: str) -> list[type[BaseModel]]:
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in key.split("."):
        models = [one for model in models for one in models_of(model.model_fields[part].annotation)]
    return models


def tables_at(key: str) -> Iterator[TableDoc]:
    yield from _tables(key, models_at(key), {})


def scenario_tables() -> Iterator[TableDoc]:
    """Document all tables of a scenario file, the top level first."""
    yield from _tables("", [ScenarioTables], {})


def _tables(
    place: str, models: list[type[BaseModel]], first_places: dict[type[BaseModel], str]
) -> Iterator[TableDoc]:
    for model in models:
        title = _titled(place, model)
        if model in first_places:
            yield TableDoc(title, model, f"The same keys as {first_places[model]}.", {})
            continue
        first_places[model] = title
        text, _ = split_doc(model.__doc__ or "")
        yield TableDoc(title, model, text, key_texts(model))
        for name, field in model.model_fields.items():
            inner = f"{place}.{name}".lstrip(".")
            inner += ".NAME" if get_origin(field.annotation) is dict else ""
            yield from _tables(inner, list(models_of(field.annotation)), first_places)


def key_texts(model: type[BaseModel]) -> dict[str, str]:
    """Return documentation, values and default of each key of a table but its `kind`."""
    documented = _documented(model)
    if issubclass(model, SettingsTable):
        documented |= {name: one.setting.doc for name, one in model.by_key.items()}
    return {
        name: _described(documented.get(name, ""), field)
        for name, field in model.model_fields.items()
        if name != "kind"
    }


def _documented(model: type[BaseModel]) -> dict[str, str]:
    docs = [split_doc(base.__doc__ or "")[1] for base in reversed(model.__mro__)]
    return {name: text for keys in docs for name, text in keys.items()}


def _titled(place: str, model: type[BaseModel]) -> str:
    kind = model.model_fields.get("kind")
    words = get_args(kind.annotation) if kind else ()
    if not place:
        return "top level"
    return f'[{place}] kind = "{words[0]}"' if words else f"[{place}]"


def split_doc(doc: str) -> tuple[str, dict[str, str]]:
    text: list[str] = []
    keys: dict[str, str] = {}
    names: list[str] = []
    for line in cleandoc(doc).splitlines():
        match = KEY_LINE.match(line)
        if match:
            names = match[1].split(", ")
            keys |= dict.fromkeys(names, match[2])
        elif names and line.startswith(" "):
            keys |= {name: f"{keys[name]} {line.strip()}" for name in names}
        else:
            names = []
            text.append(line)
    return re.sub(r"\n{3,}", "\n\n", "\n".join(text)).strip(), keys


def _described(doc: str, field: FieldInfo) -> str:
    """Documentation of a key, then its values and its default."""
    facts = [*_values(field), *_default(field)]
    return "; ".join(([doc] if doc else []) + ([", ".join(facts)] if facts else []))


def _values(field: FieldInfo) -> Iterator[str]:
    annotation = field.annotation
    words = [
        word
        for part in _parts(annotation)
        if get_origin(part) is Literal
        for word in get_args(part)
    ]
    if words:
        yield " | ".join(f'"{word}"' for word in words)
    elif get_origin(annotation) is dict:
        yield "a table for each name"
    elif annotation is SourcesTable:
        yield " | ".join(f'"{word}"' for word in WORDS) + " | list | table"
    elif any(part is bool for part in _parts(annotation)):
        yield "true or false"
    elif str in _parts(annotation):
        yield "text"
    elif models := list(models_of(annotation)):
        is_list = any(get_origin(part) is tuple for part in _parts(annotation))
        yield "list of tables" if is_list else "table" if len(models) == 1 else KINDS
    bounds = bounds_of(field)
    if {"ge", "le"} <= set(bounds):
        yield f"{bounds['ge']:g} to {bounds['le']:g}"
    else:
        yield from (f"{BOUNDS[word]} {_shown(bound)}" for word, bound in bounds.items())


def _shown(bound: Any) -> str:
    return f"{bound:g}" if isinstance(bound, int | float) else str(bound)


def _default(field: FieldInfo) -> Iterator[str]:
    default = field.default
    if field.is_required():
        yield "required"
    elif isinstance(default, SourcesTable):
        yield f'default "{default.word}"'
    elif isinstance(default, bool):
        yield f"default {str(default).lower()}"
    elif isinstance(default, int | float):
        yield f"default {default:g}"
    elif isinstance(default, datetime):
        yield f"default {default}"
    elif isinstance(default, str) and default:
        yield f'default "{default}"'
    elif isinstance(default, tuple) and default and not isinstance(default[0], BaseModel):
        yield f"default {list(default)}"


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield an annotation and all that it is made of, except what is inside tables."""
    if annotation is None or annotation is NoneType:
        return
    yield annotation
    if get_origin(annotation) is not Literal:
        for part in get_args(annotation):
            yield from _parts(part)
