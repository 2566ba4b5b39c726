"""The folder of a run, locked for one run at a time before anything is started.

The advisory lock ends with its process and leaves no file behind. `convoy run` holds it while its
recorder writes the log.
"""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from itertools import count
from pathlib import Path
from tempfile import TemporaryFile

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.stop import remove_if_empty

ROOM_BYTES = 1024 * 1024
"""Free space that a folder needs at the start."""


def folder_of(scenario: Scenario, out: Path | None) -> Path:
    """Folder of a run: `out`, or a new one that is named by the present time."""
    return out or default_folder(scenario.slug, datetime.now(tz=UTC).astimezone())


def default_folder(slug: str, started: datetime, root: Path = Path("runs")) -> Path:
    """Make the folder of a run, named by its start and the `slug` of its scenario.

    Further ones of the same second get the suffix `-2`, `-3`, ...
    """
    root.mkdir(parents=True, exist_ok=True)
    base = f"{started:%Y%m%d-%H%M%S}-{slug}"
    for number in count(1):
        folder = root / (base if number == 1 else f"{base}-{number}")
        with suppress(FileExistsError):
            folder.mkdir()
            return folder
    raise AssertionError("numbers do not end")


@contextmanager
def claimed(folder: Path, *, fresh: bool = False) -> Iterator[None]:
    """Lock `folder` for one run; remove it if it is `fresh` or new and stays empty.

    Raises ScenarioError if another run holds it or left its log in it, and OSError if it is not
    writable.
    """
    made = fresh or not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    if made:
        remove_if_empty(folder)
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _lock(descriptor, folder)
        try:
            refuse_used(folder)
            _try_to_write(folder)
            yield
        finally:
            if made:
                with suppress(OSError):  # not empty
                    folder.rmdir()
    finally:
        os.close(descriptor)


def is_claimed(folder: Path) -> bool:
    """Whether a run is writing into `folder`."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def is_running(log: Path) -> bool:
    """Whether a run is writing `log`, the log in its folder."""
    return log.name == LOG_NAME and is_claimed(log.parent)


def refuse_used(folder: Path) -> None:
    """Raise ScenarioError if `folder` holds the log or the summary of a run."""
    for path in (folder / LOG_NAME, folder / SUMMARY_NAME):
        if path.exists() or path.is_symlink():
            raise ScenarioError([f"{path}: exists; give another folder by --out"])


def _lock(descriptor: int, folder: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ScenarioError(
            [f"{folder}: another run writes into this folder; give another one by --out"]
        ) from error
    except OSError:  # a file system without locks: the log itself is never overwritten
        return


def _try_to_write(folder: Path) -> None:
    try:
        with TemporaryFile(dir=folder) as file:
            file.write(bytes(ROOM_BYTES))
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(folder)) from error
