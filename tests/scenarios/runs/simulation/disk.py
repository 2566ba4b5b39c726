"""A folder of a run on a disk that fails at the n-th write; a kill loses what was not written."""

import io
import os
from collections.abc import Callable
from pathlib import Path, PosixPath
from typing import IO, Any

from tests.scenarios.runs.simulation.scheduler import Role


class Disk:
    """Counts writes; from the one numbered `full_at` on, `full_for` of them fail with `error`."""

    def __init__(self, full_at: int | None, full_for: int, error: int) -> None:
        self.writes = 0
        self.full_at = full_at
        self._full_for = full_for
        self._error = error

    @property
    def has_failed(self) -> bool:
        return self.full_at is not None and self.writes >= self.full_at

    def write(self) -> None:
        """Note a write; raises OSError if the disk is full."""
        self.writes += 1
        if self.has_failed and self.writes < (self.full_at or 0) + self._full_for:
            raise OSError(self._error, os.strerror(self._error))


class _SimulatedFile(io.FileIO):
    """A file that loses what a killed process had not written."""

    def __init__(self, path: str, mode: str, disk: Disk, role: Role) -> None:
        super().__init__(path, mode)
        self._disk, self._role = disk, role

    def write(self, data: Any, /) -> int:
        if self._role.killed:
            return len(data)
        self._disk.write()
        return super().write(data)


def folder_of(path: Path, disk: Disk, current: Callable[[], Role | None]) -> Path:
    """Return a path below which roles write on `disk`."""

    class SimulatedPath(PosixPath):
        __slots__ = ()

        def open(self, mode: str = "r", *arguments: Any, **options: Any) -> IO[Any]:  # type: ignore[override]
            role = current()
            if role is None or not set(mode) & set("wax+"):
                return super().open(mode, *arguments, **options)
            raw = _SimulatedFile(str(self), mode.replace("b", ""), disk, role)
            if "b" in mode:
                return io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
            return io.TextIOWrapper(io.BufferedWriter(raw), encoding="utf-8")

    return SimulatedPath(path)
