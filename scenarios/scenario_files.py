"""Scenario files as text: those that ship, the user's own, and what is laid over them."""

import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

from scenarios.errors import ScenarioError
from scenarios.refusal import near
from scenarios.toml_text import OverrideError, Raw, override, parse_override

PACKAGE = Path(str(files("scenarios")))
TRACES = PACKAGE / "traces"
"""Where the recorded drives lie that ship."""

TEMPLATE = "_template"
"""The file in the library that `convoy new` writes; it is not listed."""


def library() -> tuple[str, ...]:
    """Names of the scenarios that ship."""
    names = sorted(path.stem for path in (PACKAGE / "library").glob("*.toml"))
    return tuple(name for name in names if name != TEMPLATE)


def template() -> str:
    """Text of a commented scenario that shows every key with its default."""
    return (PACKAGE / "library" / f"{TEMPLATE}.toml").read_text(encoding="utf-8")


def read_text(name_or_path: str | Path) -> tuple[str, Path, str]:
    """Give the name for messages, the folder and the text of a scenario; raises ScenarioError."""
    path = Path(name_or_path)
    if str(name_or_path) in library():
        path = PACKAGE / "library" / f"{name_or_path}.toml"
    label = path.name if str(name_or_path) in library() else str(name_or_path)
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
