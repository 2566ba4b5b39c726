"""`extends`: a scenario file merged into the file that it names as its base."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import LIBRARY, ScenarioFile, read_base
from scenarios.definition.overrides import (
    OverrideError,
    Raw,
    clear,
    override,
    parse_override,
    parsed,
)

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
