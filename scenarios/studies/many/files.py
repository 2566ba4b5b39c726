"""Files that a study writes and does not write over."""

from pathlib import Path

from scenarios.definition.errors import ScenarioError


def refuse_existing(*files: Path | None) -> None:
    """Raise ScenarioError if one of the files to be written is there already."""
    for file in files:
        if file is not None and file.exists():
            raise ScenarioError([f"{file}: exists; give another place"])
