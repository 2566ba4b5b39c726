"""Shipped channels: `links.preset = "…"`.

Reading a scenario fills in the keys of the preset, so that the scenario in a log is complete. The
name of the preset stays for titles; `preset_source` marks that its keys are filled in.
"""

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from scenarios.definition.errors import Problem
from scenarios.definition.library import PRESETS
from scenarios.definition.overrides import PRESET, Raw, laid_over
from scenarios.definition.wording import did_you_mean, toml_repr

INLINED = "preset_source"
"""Key that marks a table with the preset's keys filled in."""


@dataclass(frozen=True, slots=True)
class ChannelPreset:
    """A shipped channel: description, source of its figures, keys of `[links]` and `[[link]]`."""

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


def with_presets(raw: Raw, problems: list[Problem]) -> Raw:
    """Return a scenario's tables with the keys of each preset that they name.

    Entries of a preset follow the scenario's own. An unknown preset is added to `problems`.
    """
    changed, links, entries = dict(raw), raw.get("links"), raw.get("link", [])
    if not isinstance(entries, list):  # reported by the validation
        entries = []
    whole = [
        _whole(entry, _preset(f"link[{index}]", entry, problems, alone=True))
        for index, entry in enumerate(entries)
    ]
    if (preset := _preset("links", links, problems)) is not None:
        changed["links"] = _whole(links, preset)
        whole += preset.entries
    return changed | {"link": whole} if whole else changed


def _preset(
    key: str, table: object, problems: list[Problem], *, alone: bool = False
) -> ChannelPreset | None:
    """Return the preset whose keys a table lacks, if any; a problem is added to `problems`.

    For one link `alone` it may not be a preset with entries for single links.
    """
    if not isinstance(table, dict) or PRESET not in table or INLINED in table:
        return None
    name = table[PRESET]
    if not isinstance(name, str):
        return None  # reported by the validation
    if name not in presets():
        close = did_you_mean(name, presets())
        allowed = close or f", allowed {', '.join(presets())}"
        problems.append((f"{key}.{PRESET}", f"given {toml_repr(name)}{allowed}"))
        return None
    preset = read_preset(name)
    if alone and preset.entries:
        problems.append((f"{key}.{PRESET}", f"given {toml_repr(name)}, allowed in [links] only"))
        return None
    return preset


def _whole(table: Any, preset: ChannelPreset | None) -> Any:
    if preset is None:
        return table
    # Without the key `preset`, which would replace the table below.
    own = {key: value for key, value in table.items() if key != PRESET}
    return laid_over(preset.links, own) | {PRESET: preset.name, INLINED: preset.source}
