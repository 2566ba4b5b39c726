"""Scenario files as text: those that ship, the user's own, and what is laid over them."""

import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from scenarios.definition.errors import ScenarioError
from scenarios.definition.refusal import near
from scenarios.definition.toml_text import OverrideError, Raw, override, parse_override

LIBRARY = Path(str(files("scenarios"))) / "library"
TRACES = LIBRARY / "traces"
"""Where the recorded drives lie that ship."""

TEMPLATE = "_template"
"""The file in the library that `convoy new` writes; it is not listed."""


def library() -> tuple[str, ...]:
    """Names of the scenarios that ship."""
    return tuple(sorted(_shipped()))


def _shipped() -> dict[str, Path]:
    """File of each scenario that ships, by name."""
    return {path.stem: path for path in LIBRARY.rglob("*.toml") if path.stem != TEMPLATE}


def template() -> str:
    """Text of a commented scenario that shows every key with its default."""
    return (LIBRARY / f"{TEMPLATE}.toml").read_text(encoding="utf-8")


def read_text(name_or_path: str | Path) -> tuple[str, Path, str]:
    """Give the name for messages, the folder and the text of a scenario; raises ScenarioError."""
    shipped = _shipped().get(str(name_or_path))
    path = shipped or Path(name_or_path)
    label = path.name if shipped else str(name_or_path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise ScenarioError([f"{label}: {_not_found(path)}"]) from error
    except OSError as error:
        raise ScenarioError([f"{label}: {(error.strerror or 'cannot be read').lower()}"]) from error
    except UnicodeDecodeError as error:
        why = f"not a text file, byte {error.start} is not UTF-8"
        raise ScenarioError([f"{label}: {why}"]) from error
    if not text.strip():
        raise ScenarioError([f"{label}: empty file, `convoy new` writes a commented scenario"])
    return label, path.parent, text


def _not_found(path: Path) -> str:
    beside = [entry.name for entry in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    guess = near(path.name, beside) or near(path.stem, library())
    return f"no such file{guess or ', shipped scenarios are ' + ', '.join(library())}"


def parse(text: str, label: str, overrides: Sequence[str]) -> tuple[Raw, list[str]]:
    """Parse a scenario and lay `overrides` over it; gives the tables and the keys overridden."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError([f"{label}: not valid TOML: {error}"]) from error
    changed = []
    for one in overrides:
        try:
            parts, value = parse_override(one)
            override(raw, parts, value)
        except OverrideError as error:
            raise ScenarioError([f"--set {one}: {error}"]) from error
        changed.append(".".join(parts))
    return raw, changed
