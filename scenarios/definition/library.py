"""Scenario files as text: the shipped ones, the user's own, and those of recorded drives."""

import re
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

import tomli_w

from scenarios.definition.errors import ScenarioError
from scenarios.definition.wording import closest, toml_repr

LIBRARY = Path(str(files("scenarios"))) / "library"
TRACES = LIBRARY / "traces"
"""Folder of the shipped recorded drives."""
PRESETS = LIBRARY / "presets"
"""Folder of the channel presets."""

DRILLS = LIBRARY / "drills"
"""Folder of the shipped drills: scenarios in which something fails, with limits."""

ATTACHED_AS = "scenario.toml"
"""Name of the scenario of a run among the attachments of its log."""

MAX_BYTES = 200_000_000
"""Largest scenario file: one with the points of a long drive has a tenth of this."""

NAME_CUTOFF = 0.7
"""Least similarity of a file name that is offered for another."""

TEMPLATE = "_template"
"""The file that `convoy new` writes; it is not listed."""

LOG = "run.mcap"
"""Log of a run, in its folder."""

LONGEST_NAME = 32
"""Longest name of a scenario (characters)."""

PLAIN_NAMES = frozenset({LOG})
"""Names of files that do not identify a drive."""

_TOML_START = re.compile(
    rb"(?:\xef\xbb\xbf)?(?:\s|#[^\n]*\n)*(?!sep\b)\[{0,2}[A-Za-z_][\w.-]*\s*[=\]]"
)
"""First key or table of a TOML file; `sep=;` begins a CSV file."""

_START_BYTES = 65_536


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """Text of a scenario file.

    `label` names the file in error lines. Traces and the base of `extends` are searched in
    `folder`. `path` is None without a file. A `recorded` scenario is that of a log. One of a drive
    (`is_drive`) has a recorded drive only, and is labelled with its file.
    """

    label: str
    folder: Path
    text: str
    path: Path | None = None
    recorded: bool = False
    is_drive: bool = False


def library() -> tuple[str, ...]:
    return tuple(sorted(name for name, path in _shipped().items() if path.parent != DRILLS))


def template() -> str:
    """Return the commented scenario that `convoy new` writes."""
    return (LIBRARY / f"{TEMPLATE}.toml").read_text(encoding="utf-8")


def drills() -> tuple[str, ...]:
    return tuple(sorted(name for name, path in _shipped().items() if path.parent == DRILLS))


def _shipped() -> dict[str, Path]:
    result = (path for path in LIBRARY.rglob("*.toml") if path.parent != PRESETS)
    return {path.stem: path for path in result if path.stem != TEMPLATE}


def read_file(name_or_path: str | Path) -> ScenarioFile:
    """Read a shipped scenario by its name, or a file; raises ScenarioError.

    A file or folder of a recorded drive is a scenario with this drive as its path.
    """
    shipped = _shipped().get(str(name_or_path))
    path = shipped or Path(name_or_path)
    label = path.name if shipped else str(name_or_path)
    try:
        if _is_drive(path):
            return _scenario_of_drive(path)
        return ScenarioFile(label, path.parent, _text(path), path)
    except FileNotFoundError as error:
        hint = _hint(path) or (
            f", shipped scenarios are {', '.join(library())}, and `convoy list` names the drills"
        )
        raise ScenarioError([f"{label}: no such file{hint}"]) from error
    except ValueError as error:
        raise ScenarioError([f"{label}: {error}"]) from error


def is_drive(name_or_path: str | Path) -> bool:
    """Whether `read_file` takes a name for a recorded drive."""
    return str(name_or_path) not in _shipped() and _is_drive(Path(name_or_path))


def is_run(name_or_path: str | Path) -> bool:
    """Whether `read_file` takes a name for the log of a run, or for its folder."""
    path = Path(name_or_path)
    return is_drive(path) and (path.suffix == ".mcap" or is_file(path / LOG))


def _is_drive(path: Path) -> bool:
    """Whether a file or folder exists that is no TOML file, by its name or its first key."""
    try:
        if path.is_dir():
            return True
        if path.suffix.lower() == ".toml" or not path.is_file():
            return False
        with path.open("rb") as file:
            return _TOML_START.match(file.read(_START_BYTES)) is None
    except OSError:
        return False  # reading it as a scenario reports the reason


def _scenario_of_drive(path: Path) -> ScenarioFile:
    file = path / LOG if (path / LOG).is_file() else path
    named = whole = file.resolve()
    if file.name in {"", ".."}:  # the working folder, or the one above
        file = whole
    while named.name in PLAIN_NAMES:
        named = named.parent
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", named.stem).strip("_")
    name = name if name[:1].isalpha() else f"drive_{name}"
    name = name[:LONGEST_NAME].rstrip("_")
    tables = {"name": name, "path": {"kind": "trace", "file": file.name}}
    return ScenarioFile(str(file), file.parent, tomli_w.dumps(tables), file, is_drive=True)


def read_base(extending: ScenarioFile, given: object) -> ScenarioFile:
    """Read the file that `extending` names as its base; raises ScenarioError."""
    problem = f"{extending.label}: extends: given {toml_repr(given)}"
    allowed = f"allowed a path relative to this file, or {', '.join(library())}"
    if not isinstance(given, str) or not given:
        raise ScenarioError([f"{problem}, {allowed}"])
    shipped = _shipped().get(given)
    path = shipped or extending.folder / given
    try:
        if _is_drive(path) and (not path.is_dir() or (path / LOG).is_file()):
            return _scenario_of_drive(path)
        return ScenarioFile(path.name if shipped else str(path), path.parent, _text(path), path)
    except FileNotFoundError as error:
        raise ScenarioError([f"{problem}, no such file{_hint(path)}, {allowed}"]) from error
    except ValueError as error:
        raise ScenarioError([f"{problem}, {error}, {allowed}"]) from error


def _text(path: Path) -> str:
    """Text of a file; raises FileNotFoundError, or ValueError with the reason in words."""
    try:
        if path.is_char_device():  # such as /dev/zero, which never ends
            raise ValueError("not a file")
        if path.stat().st_size > MAX_BYTES:
            raise ValueError(f"larger than {MAX_BYTES // 1_000_000} MB")
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise
    except OSError as error:
        raise ValueError((error.strerror or "cannot be read").lower()) from error
    except UnicodeDecodeError as error:
        raise ValueError(f"not a text file, byte {error.start} is not UTF-8") from error
    if not text.strip():
        raise ValueError("empty file, `convoy new` writes a commented scenario")
    return text


def is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # such as a name that is too long for any file
        return False


def exists(path: Path) -> bool:
    """Whether `path` is a file or folder; False for a name that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _hint(path: Path) -> str:
    """Return a question that offers a file next to `path` or a shipped scenario."""
    beside = [entry.stem for entry in path.parent.glob("*.toml")] if path.parent.is_dir() else []
    if match := closest(path.stem, beside, cutoff=NAME_CUTOFF):
        return f", did you mean {match}.toml?"
    match = closest(path.stem, (*library(), *drills()), cutoff=NAME_CUTOFF)
    return f", did you mean {match}?" if match else ""
