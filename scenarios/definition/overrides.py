"""Overrides: `key.path=value` applied to the tables of a parsed scenario file."""

import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import LIBRARY, ScenarioFile, read_base

Raw = dict[str, Any]
"""A parsed TOML table before validation."""


_PART = re.compile(r"\w[\w-]*")
"""Name or index in an overridden key."""

DEEPEST = 20
"""Deepest nesting of tables and lists; scenarios need five levels."""
TOO_DEEP = f"tables or lists more than {DEEPEST} deep inside one another"


class OverrideError(ValueError):
    """An override that cannot be applied, with its reason."""


def parsed(text: str) -> Raw:
    """Parse TOML; raises ValueError in one line, also for too deep nesting."""
    try:
        raw = tomllib.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    layer: list[Any] = [raw]
    for _ in range(DEEPEST):
        layer = [value for one in layer for value in _inside(one)]
    if layer:
        raise ValueError(TOO_DEEP)
    return raw


def _inside(value: object) -> list[Any]:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [one for one in inner if isinstance(one, dict | list)]


def override_text(key: str, value: object) -> str:
    """Write `key=value` as on the command line; raises OverrideError for a value without TOML."""
    try:
        return f"{key}={value_text(value)}"
    except TypeError as error:
        raise OverrideError(f"{key}: {error}") from error


def value_text(value: object) -> str:
    """Write a value as TOML in one line, a plain text without quotes.

    NumPy's numbers and paths are accepted. Raises TypeError for another type.
    """
    if isinstance(value, str | PurePath):
        text = str(value)
        return text if text and _reads_as_text(text) else json.dumps(text)
    return _inline(value)


def _reads_as_text(text: str) -> bool:
    """Whether a text without quotes is read as itself, also in a list of values."""
    return not re.search(r"[\s,\"'\[\]{}]", text) and parse_override(f"key={text}")[1] == text


def _inline(value: object) -> str:
    match getattr(value, "tolist", lambda: value)():
        case bool(truth):
            return "true" if truth else "false"
        case int(number) | float(number):
            return repr(number)
        case str(text):
            return json.dumps(text)
        case PurePath() as path:
            return json.dumps(str(path))
        case list(entries) | tuple(entries):
            return f"[{', '.join(map(_inline, entries))}]"
        case dict(table):
            entries = [f"{json.dumps(str(key))} = {_inline(entry)}" for key, entry in table.items()]
            return f"{{{', '.join(entries)}}}"
        case other:
            raise TypeError(f"given {other!r}, allowed a number, text, truth value, list or table")


def key_parts(key: str) -> tuple[str, ...]:
    """Names and indices of a dotted key; an index may be in brackets."""
    return tuple(re.sub(r"\[(\d+)\]", r".\1", key.strip()).split("."))


def value_at(table: Raw, key: str) -> Any:
    """Value of a dotted key, or None. Raises OverrideError for a key inside a missing list entry.

    `override` would append that entry, without its other keys.
    """
    parts = key_parts(key)
    here: Any = table
    for depth, part in enumerate(parts):
        entries = [] if here is None else here
        if part.isdecimal() and isinstance(entries, list):
            is_missing = int(part) >= len(entries)
            if is_missing and depth < len(parts) - 1:
                raise _wrong_index(parts[: depth + 1], len(entries))
            here = None if is_missing else entries[int(part)]
        else:
            here = here.get(part) if isinstance(here, dict) else None
    return here


def parse_override(text: str) -> tuple[tuple[str, ...], Any]:
    """Split `key.path=value` into key parts and value; a value that is not TOML is a text."""
    key, equals, value = text.partition("=")
    parts = key_parts(key)
    if not equals or not all(map(_PART.fullmatch, parts)):
        hint = _intended(text)
        raise OverrideError(f"given {json.dumps(text)}, allowed key=value, such as seed=7{hint}")
    if len(parts) > DEEPEST:
        raise OverrideError(f"given {TOO_DEEP}, allowed a key such as links.loss_ratio")
    try:
        return parts, parsed(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError as error:
        if value.strip()[:1] in {"[", "{"}:
            raise OverrideError(_invalid(value, error)) from error
        return parts, value.strip()
    except ValueError as error:
        raise OverrideError(str(error)) from error


def _invalid(value: str, error: tomllib.TOMLDecodeError) -> str:
    """Name the part of a list or table that is not valid TOML."""
    column = re.search(r"line 1, column (\d+)", str(error))
    if column is None:
        return "not valid TOML: a bracket is not closed"
    at = int(column[1]) - len("value = ") - 1
    before = re.split(r"[\s,={}\[\]]", value[:at])[-1]
    after = re.split(r"[\s,={}\[\]]", value[at:])[0]
    part = f"{before}{after}" or value[at:].strip() or value.strip()
    return (
        f"not valid TOML at {json.dumps(part, ensure_ascii=False)}, allowed numbers without a unit "
        "and texts in quotes"
    )


def _intended(text: str) -> str:
    """Return ", did you mean …?" for texts such as "--links/loss_ratio: 0.4"."""
    match = re.fullmatch(r"-*([A-Za-z][\w./-]*?)\s*(?:=+|:|\s)\s*(\S+)", text.strip())
    return f", did you mean {match[1].replace('/', '.')}={match[2]}?" if match else ""


def override(table: Raw, parts: Sequence[str], value: object) -> None:
    """Set the value of a key in `table`, with the tables and lists around it that are missing."""
    is_new = parts[0] not in table
    try:
        _set(table, parts, value)
    except OverrideError:
        if is_new:
            table.pop(parts[0], None)
        raise


def _set(table: Raw, parts: Sequence[str], value: object) -> None:
    here: Any = table
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        made: Any = [] if not last and parts[depth + 1].isdecimal() else {}
        if isinstance(here, list):
            index = _index(here, parts[: depth + 1])
            here[index] = value if last else here[index]
            here = here[index]
        elif isinstance(here, dict):
            here[part] = value if last else here.get(part, made)
            here = here[part]
        else:
            raise OverrideError(f"{'.'.join(parts[:depth])} is a value, it has no key {part}")


def clear(table: Raw, parts: Sequence[str], kept: Iterable[str]) -> None:
    """Delete the keys next to `parts`, except the ends of a link and the dotted keys `kept`."""
    here: Any = table
    for part in parts[:-1]:
        here = here[int(part)] if isinstance(here, list) else here[part]
    whole = {tuple(key.split("."))[: len(parts)] for key in kept}
    for key in here.keys() - {parts[-1], "sender", "receiver"}:
        if (*parts[:-1], key) not in whole:
            del here[key]


def _index(entries: list[Any], parts: Sequence[str]) -> int:
    if not parts[-1].isdecimal() or int(parts[-1]) > len(entries):
        raise _wrong_index(parts, len(entries) + 1)
    if int(parts[-1]) == len(entries):
        entries.append({})
    return int(parts[-1])


def _wrong_index(parts: Sequence[str], count: int) -> OverrideError:
    """Refuse the index at the end of `parts` of a list that has `count` allowed ones."""
    key, index = ".".join(parts[:-1]), parts[-1]
    last = f" to {count - 1}" if count > 1 else ""
    allowed = f"allowed 0{last}" if count else "which has no entries"
    hint = f", did you mean vehicle.v{index}?" if key == "vehicle" else ""
    return OverrideError(f"given index {index} of {key}, {allowed}{hint}")


# ---- `extends`: a scenario file merged into the file that it names as its base


EXTENDS = "extends"
PRESET = "preset"

Key = tuple[str, ...]
"""Names of the tables around a value, and its own name."""


@dataclass(frozen=True, slots=True)
class MergedScenario:
    """The merged tables of a scenario file, its bases and overrides, before validation.

    `files` are in order, the last base first. `given_in` is the file of each value; an array is one
    value. `overridden` are the keys changed by `--set`; `invalid_overrides` has a line for each
    override that cannot be applied.
    """

    raw: Raw
    files: tuple[ScenarioFile, ...]
    given_in: dict[Key, ScenarioFile]
    overridden: tuple[str, ...]
    invalid_overrides: tuple[str, ...] = ()

    def source(self, key: str) -> str:
        """Return the source of a key such as `link[0].sender`: --set or a file.

        An override counts for keys inside and around it.
        """
        plain = key.replace("[", ".").replace("]", "")
        if any(_around(one, plain) or _around(plain, one) for one in self.overridden):
            return "--set"
        return self._file(key).label

    def folder(self, key: str) -> Path:
        """Return the folder in which the file named by a key is searched.

        It is that of the scenario file, and the working folder for overrides of a shipped scenario.
        """
        if any(_around(one, key) for one in self.overridden):
            own = self.files[-1].folder
            return Path() if own.is_relative_to(LIBRARY) else own
        return self._file(key).folder

    def _file(self, key: str) -> ScenarioFile:
        """Return the file that gives a key, or else values next to it; the last of several."""
        parts = tuple(re.split(r"[\[ ]", key)[0].split("."))
        while parts:
            givers = [
                file
                for given, file in self.given_in.items()
                if given[: len(parts)] == parts or parts[: len(given)] == given
            ]
            if givers:
                return max(givers, key=self.files.index)
            parts = parts[:-1]
        return self.files[-1]


def _around(outer: str, inner: str) -> bool:
    return f"{inner}.".startswith(f"{outer}.")


def merged(file: ScenarioFile, overrides: Sequence[str]) -> MergedScenario:
    """Parse a scenario file, merge it into its bases, and apply `overrides`."""
    chain = _with_bases(file)
    raw: Raw = {}
    given_in: dict[Key, ScenarioFile] = {}
    for one, tables in chain:
        raw = laid_over(raw, tables)
        given_in |= dict.fromkeys(_values(tables), one)
    kept = set(_values(raw))
    given_in = {key: one for key, one in given_in.items() if key in kept}
    overridden, invalid = _override(raw, overrides)
    return MergedScenario(raw, tuple(one for one, _ in chain), given_in, overridden, invalid)


def _with_bases(file: ScenarioFile) -> list[tuple[ScenarioFile, Raw]]:
    """Parse a file and its bases, the last base first."""
    chain = [(file, _parsed(file))]
    while EXTENDS in (tables := chain[0][1]):
        base = read_base(chain[0][0], tables.pop(EXTENDS))
        chain.insert(0, (base, _parsed(base)))
        if any(_same(base, other) for other, _ in chain[1:]):
            names = ", ".join(one.label for one, _ in reversed(chain))
            raise ScenarioError([f"{chain[1][0].label}: {EXTENDS}: files in a circle: {names}"])
    return chain


def _same(one: ScenarioFile, other: ScenarioFile) -> bool:
    if one.path is None or other.path is None:
        return False
    return one.path.resolve() == other.path.resolve()


def _parsed(file: ScenarioFile) -> Raw:
    try:
        return parsed(file.text)
    except ValueError as error:
        raise ScenarioError([f"{file.label}: not valid TOML: {error}"]) from error


def laid_over(base: Raw, tables: Raw) -> Raw:
    """Merge tables key by key. Other values and tables of another `kind` or `use` are replaced.

    A table with a `preset` replaces the one in `base`, since a preset is a complete channel.
    """
    result = dict(base)
    for key, value in tables.items():
        below = base.get(key)
        if isinstance(value, dict) and isinstance(below, dict) and _alike(below, value):
            result[key] = laid_over(below, value)
        else:
            result[key] = value
    return result


def _alike(below: Raw, table: Raw) -> bool:
    """Whether two tables can be merged: of one `kind`, and no preset."""
    if PRESET in table:
        return False
    return all(
        word not in below or table.get(word, below[word]) == below[word] for word in ("kind", "use")
    )


def _values(tables: Raw, inside: Key = ()) -> Iterator[Key]:
    """Yield the keys of all values, where arrays and empty tables are values."""
    for key, value in tables.items():
        if isinstance(value, dict) and value:
            yield from _values(value, (*inside, key))
        else:
            yield (*inside, key)


def _override(raw: Raw, overrides: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Apply `overrides` to the tables; returns the keys changed, and lines for invalid ones.

    A preset replaces everything that the files have in its table.
    """
    changed: list[str] = []
    invalid: list[str] = []
    for text in overrides:
        try:
            parts, value = parse_override(text)
            if parts[0] == EXTENDS:
                invalid.append(f"--set {text}: allowed in a scenario file only")
                continue
            override(raw, parts, value)
            if parts[-1] == PRESET:
                clear(raw, parts, changed)
            changed.append(".".join(parts))
        except OverrideError as error:
            invalid.append(f"--set {text}: {error}")
    return tuple(changed), tuple(invalid)
