"""Files that a study writes and does not write over."""

from pathlib import Path

from scenarios.definition.errors import ScenarioError


def refuse_existing(out: Path, *names: str) -> None:
    """Raise ScenarioError if one of the files is in the folder `out` already."""
    for name in names:
        if (out / name).exists():
            raise ScenarioError([f"{out / name}: exists; give another folder by --out"])
