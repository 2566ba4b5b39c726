"""The running runs of this user on this machine, and where to join them.

Each has a small file in a folder of the user. `convoy run` holds an advisory lock on it that ends
with the process, so files left behind are recognised.
"""

import fcntl
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

SUFFIX = ".json"


@dataclass(frozen=True, slots=True)
class OpenRun:
    """A running run: name, endpoint of its router, and folder that it writes into."""

    run: str
    endpoint: str
    folder: str


def runtime_folder() -> Path:
    """Folder of the files: the user's own, removed at reboot."""
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime and Path(runtime).is_dir():
        return Path(runtime) / "convoy"
    return Path(tempfile.gettempdir()) / f"convoy-{os.getuid()}"


@contextmanager
def announced(run: OpenRun, where: Path | None = None) -> Iterator[None]:
    """Let other processes of this user find a run, if the folder is writable."""
    folder = where or runtime_folder()
    path = folder / f"{run.run}-{os.getpid()}{SUFFIX}"
    descriptor = None
    with suppress(OSError):
        descriptor = _write(path, run)
    try:
        yield
    finally:
        if descriptor is not None:
            path.unlink(missing_ok=True)
            os.close(descriptor)


def _write(path: Path, run: OpenRun) -> int:
    """Write the file under its lock, then rename it; returns the locking descriptor."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    partial = path.with_suffix(".part")
    descriptor = os.open(partial, os.O_CREAT | os.O_WRONLY | os.O_TRUNC, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with open(descriptor, "w", encoding="utf-8", closefd=False) as file:
            json.dump(asdict(run), file)
        partial.replace(path)
    except OSError:
        os.close(descriptor)
        partial.unlink(missing_ok=True)
        raise
    return descriptor


def open_runs(where: Path | None = None) -> list[OpenRun]:
    """List the running runs by name and remove files that ended runs left behind."""
    folder = where or runtime_folder()
    if not folder.is_dir() or folder.stat().st_uid != os.getuid():  # not our own
        return []
    runs = [run for path in sorted(folder.glob(f"*{SUFFIX}")) if (run := _read(path))]
    return sorted(runs, key=lambda run: run.run)


def _read(path: Path) -> OpenRun | None:
    """Parse a file; None if its run has ended."""
    with suppress(OSError, ValueError, TypeError), path.open(encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return OpenRun(**json.load(file))
        path.unlink(missing_ok=True)
    return None
