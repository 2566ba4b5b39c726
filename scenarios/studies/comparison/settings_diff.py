"""Settings of two runs that differ: the scenario with its defaults, seed, clock and program."""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from scenarios.definition.library import ATTACHED_AS
from scenarios.results.summarise import METADATA_NAME
from scenarios.results.summary import RunIdentity
from transport.log.errors import LogError
from transport.log.reader import LogReader

NOT_SETTINGS = {"overrides", "description"}
"""Keys of a recorded scenario that repeat or describe other keys."""
LISTED_NUMBERS = 6
"""Longest list of numbers that is shown whole."""


@dataclass(frozen=True, slots=True)
class SettingDifference:
    """A key with its values in two runs, as text; empty where the key is not set."""

    key: str
    a: str
    b: str


def setting_differences(a: LogReader, b: LogReader) -> tuple[SettingDifference, ...]:
    """List the settings that differ between two logs, those of the scenario first.

    A damaged log may lack its scenario; then only what both logs hold is compared.
    """
    groups = []
    for read in (_scenario_settings, _program):
        of_a, of_b = read(a), read(b)
        groups.append((of_a, of_b) if of_a and of_b else ({}, {}))
    return tuple(difference for of_a, of_b in groups for difference in differences_of(of_a, of_b))


def differences_of(a: Mapping[str, Any], b: Mapping[str, Any]) -> Iterator[SettingDifference]:
    """Yield the differing values of two tables with dotted keys."""
    for key in dict.fromkeys((*a, *b)):
        if (key in a) != (key in b) or a.get(key) != b.get(key):
            yield SettingDifference(key, *_texts(a.get(key), b.get(key)))


def _scenario_settings(reader: LogReader) -> dict[str, Any]:
    attached = reader.attachments().get(ATTACHED_AS)
    if attached is None:
        return {}
    try:
        tables = tomllib.loads(attached.decode())
    except ValueError as error:  # not UTF-8, or not TOML
        raise LogError(f"{reader.path} ({ATTACHED_AS}): {error}") from error
    return {key: value for key, value in flattened(tables) if key.split(".")[0] not in NOT_SETTINGS}


def _program(reader: LogReader) -> dict[str, Any]:
    values = reader.metadata().get(METADATA_NAME)
    if not values:
        return {}
    identity = RunIdentity.of_values(values)
    programs = {f"version of {name}": version for name, version in identity.versions.items()}
    programs["digest of the sources"] = identity.sources
    for name, digest in identity.plug_ins.items():
        programs[f"digest of {name}"] = digest
    return {"clock": identity.clock, **programs}


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and values; tables in lists are numbered from 1."""
    for name, value in table.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping):
            yield from flattened(value, f"{key}.")
        elif isinstance(value, list) and value and all(isinstance(one, Mapping) for one in value):
            for number, one in enumerate(value, 1):
                yield from flattened(one, f"{key}[{number}].")
        else:
            yield key, value


def _texts(a: Any, b: Any) -> tuple[str, str]:
    if isinstance(a, list) and isinstance(b, list) and max(len(a), len(b)) > LISTED_NUMBERS:
        pairs = enumerate(zip(a, b, strict=False))
        place = next((n for n, (one, other) in pairs if one != other), min(len(a), len(b)))
        return _item(a, place), _item(b, place)
    return _text(a), _text(b)


def _item(values: list[Any], place: int) -> str:
    value = _text(values[place]) if place < len(values) else "none"
    return f"{value} as number {place + 1} of {len(values)}"


def _text(value: Any) -> str:
    if value is None:
        return ""
    return str(value).lower() if isinstance(value, bool) else str(value)
