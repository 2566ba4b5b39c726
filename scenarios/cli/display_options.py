"""Options for what a run displays and prints."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Tables = Literal["news", "all"]
"""Printed tables: that of the vehicles and those with news, or all."""


@dataclass(frozen=True, slots=True)
class DisplayOptions:
    rerun: str = "off"
    quiet: bool = False
    tables: Tables = "news"

    @property
    def arguments(self) -> Sequence[str]:
        """The same options for another `convoy` command."""
        quiet = ["--quiet"] if self.quiet else []
        return ["--rerun", self.rerun, "--tables", self.tables, *quiet]


def start_line(run: str, folder: Path, endpoint: str = "") -> str:
    router = f", router {endpoint}" if endpoint else ""
    return f"run {run}: writes {folder}/{router}"
