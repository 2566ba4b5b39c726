"""Shipped channels: `links.preset = "…"` lays one under what a scenario says of its links.

When a scenario is read, the keys of the preset are put in, so that the scenario inside a log says
all: the preset's name stays for titles, and `preset_source` says that its keys are there.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from scenarios.definition.error_messages import did_you_mean, toml_repr
from scenarios.definition.errors import SettingError
from scenarios.definition.extends import PRESET, laid_over
from scenarios.definition.library import PRESETS
from scenarios.definition.overrides import Raw

INLINED = "preset_source"
"""The key that says that a preset's keys are in the table already."""


@dataclass(frozen=True, slots=True)
class ChannelPreset:
    """A shipped channel: what it is, where its figures are from, and the keys of `[links]`.

    One that treats some links apart has `entries` too, as those of `[[link]]`.
    """

    name: str
    description: str
    source: str
    links: Raw
    entries: tuple[Raw, ...] = ()


def presets() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in PRESETS.glob("*.toml")))


def read_preset(name: str) -> ChannelPreset:
    if name not in presets():
        raise KeyError(name)
    return _read(PRESETS / f"{name}.toml")


@cache
def _read(path: Path) -> ChannelPreset:
    raw = tomllib.loads(path.read_text(encoding="utf-8"))
    entries = tuple(raw.get("link", ()))
    return ChannelPreset(path.stem, raw["description"], raw["source"], raw["links"], entries)


def with_presets(raw: Raw) -> Raw:
    """Return a scenario's tables with the keys of each preset that they name; raises Refused.

    Entries of a preset come behind the scenario's own.
    """
    changed, links, entries = dict(raw), raw.get("links"), raw.get("link", [])
    if not isinstance(entries, list):  # which is refused later
        entries = []
    whole = [
        _whole(entry, _preset(f"link[{index}]", entry, alone=True))
        for index, entry in enumerate(entries)
    ]
    if (preset := _preset("links", links)) is not None:
        changed["links"] = _whole(links, preset)
        whole += preset.entries
    return changed | {"link": whole} if whole else changed


def _preset(key: str, table: object, *, alone: bool = False) -> ChannelPreset | None:
    """Return the preset whose keys a table lacks, if any; raises Refused.

    For a link `alone` it may not be one that treats some links apart.
    """
    if not isinstance(table, dict) or PRESET not in table or INLINED in table:
        return None
    name = table[PRESET]
    if not isinstance(name, str) or name not in presets():
        close = did_you_mean(name, presets()) if isinstance(name, str) else ""
        allowed = ", ".join(presets())
        raise SettingError(f"{key}.{PRESET}", f"given {toml_repr(name)}, allowed {allowed}{close}")
    preset = read_preset(name)
    if alone and preset.entries:
        raise SettingError(f"{key}.{PRESET}", f"given {toml_repr(name)}, allowed in [links] only")
    return preset


def _whole(table: Any, preset: ChannelPreset | None) -> Any:
    if preset is None:
        return table
    # Whether the table names a preset must not matter here: it would replace what is under it.
    own = {key: value for key, value in table.items() if key != PRESET}
    return laid_over(preset.links, own) | {PRESET: preset.name, INLINED: preset.source}
