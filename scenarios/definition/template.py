"""The commented scenario that `convoy new` writes; keys of settings classes are generated."""

import re
from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import Any, get_origin

import tomli_w
from pydantic import BaseModel

from scenarios.definition.library import LIBRARY, TEMPLATE
from scenarios.definition.schema.limit_rows import LIMITS, LimitRow
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import SettingField, SettingsTable, fields_of
from scenarios.definition.validation.model_fields import models_of

COLUMN, WIDTH = 32, 100
"""Column of the comments behind keys, and width of lines."""


def template() -> str:
    """Text of a commented scenario that shows every key with its default.

    A line `#: key.of.a.table` stands for the keys of that table, from its settings class, and
    `#: limits` for the table of limits.
    """
    text = (LIBRARY / f"{TEMPLATE}.toml").read_text(encoding="utf-8")
    return re.sub(r"^#: (\S+)$", lambda found: _lines_of(found[1]), text, flags=re.MULTILINE)


def _lines_of(key: str) -> str:
    if key == "limits":
        return "\n".join(line for row in LIMITS.values() for line in _limit(row))
    table: type[BaseModel] = ScenarioTables
    for part in key.split("."):
        table, *others = models_of(table.model_fields[part].annotation)
    kinds = [one for one in (table, *others) if issubclass(one, SettingsTable)]
    lines = [] if len(kinds) == 1 else list(_kinds(kinds))
    ordered = sorted(kinds[0].by_key.values(), key=_rank)
    return "\n".join([*lines, *(line for one in ordered for line in _entry(key, one))])


def _kinds(kinds: Sequence[type[SettingsTable[Any]]]) -> Iterator[str]:
    common = kinds[0].by_key
    for place, table in enumerate(kinds):
        kind = f'kind = "{table.model_fields["kind"].default}"'
        what = _lower(_summary(table.settings))
        if not place:
            yield f"{kind:{COLUMN}}# {what}; or one of:"
            continue
        yield from _comment(f"{what}:")
        yield f"#     {kind}"
        for key, one in table.by_key.items():
            if key not in common:
                yield from _key(one, "#     ")


def _rank(one: SettingField) -> int:
    """Order of keys, lists of tables, and tables: a table ends what comes before it."""
    return 0 if not one.classes else 1 if get_origin(one.kind) is tuple else 2


def _entry(table: str, one: SettingField) -> Iterator[str]:
    """Lines for an entry of a table: a key, a list of tables, or a table."""
    if not one.classes:
        yield from _key(one)
        return
    yield from ("", *_comment(f"{one.setting.doc}:"))
    if get_origin(one.kind) is tuple:
        yield f"# {one.key} = ["
        for word, settings in one.classes.items():
            yield f"#     {_inline(word, settings)},"
        yield "# ]"
    else:
        yield from _inner_table(f"{table}.{one.key}", one)


def _inner_table(key: str, one: SettingField) -> Iterator[str]:
    """Lines for a table that is left out by default; of several kinds the first one is whole."""
    first, *others = one.classes.items()
    yield f"# [{key}]"
    for inner in _examples(*first):
        yield f"# {inner}"
    for word, kind in others:
        yield from _comment(f"or {_lower(_summary(kind))}:")
        for inner in _examples(word, kind):
            yield f"#     {inner}"


def _key(one: SettingField, prefix: str = "") -> Iterator[str]:
    """Lines for a key: its default, or an example behind `#`, and its documentation."""
    prefix = prefix or ("" if one.default_in_key is not None else "# ")
    yield from _documented(prefix, f"{one.key} = {_value(one)}", one.setting.doc)


def _limit(row: LimitRow) -> Iterator[str]:
    """Lines for a limit: an example behind `#`, and its documentation."""
    yield from _documented("# ", tomli_w.dumps({row.key: row.example}).strip(), row.doc)


def _documented(prefix: str, entry: str, text: str) -> Iterator[str]:
    """Lines for an entry with its documentation beside it, or below if it is long."""
    doc = wrap(text, WIDTH - COLUMN - 2)
    if len(prefix + entry) >= COLUMN and doc:
        doc.insert(0, "")
    for place, line in enumerate(doc or [""]):
        start = prefix.rstrip() if place else prefix + entry
        yield f"{start:{COLUMN}}{line and f'# {line}'}".rstrip()


def _examples(word: str, settings: type[Any]) -> Iterator[str]:
    if word:
        yield f'kind = "{word}"'
    for one in fields_of(settings):
        if (value := _value(one)) is not None:
            yield f"{one.key} = {value}"


def _inline(word: str, settings: type[Any]) -> str:
    return f"{{ {', '.join(_examples(word, settings))} }}"


def _value(one: SettingField) -> str | None:
    """Default or example of a key as TOML; None where there is neither."""
    if one.classes:
        entries = [_inline(word, settings) for word, settings in one.classes.items()]
        return f"[{', '.join(entries)}]" if get_origin(one.kind) is tuple else entries[0]
    value = one.default_in_key if one.default_in_key is not None else one.setting.example
    return None if value is None else tomli_w.dumps({"": value}).partition(" = ")[2].strip()


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in wrap(text[:1].upper() + text[1:], WIDTH - 2)]


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


def _summary(kind: type[Any]) -> str:
    """First sentence of a docstring."""
    sentence = (kind.__doc__ or kind.__name__).partition("\n\n")[0]
    return " ".join(sentence.split()).rstrip(".")
