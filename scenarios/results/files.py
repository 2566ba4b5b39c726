"""The two files of a run's folder, and files that are written whole or not at all.

The summary of a run is also attached to its log.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LOG_NAME = "run.mcap"
SUMMARY_NAME = "summary.json"


def write_whole(path: Path, data: bytes, *, new: bool = False) -> None:
    """Put a file in its place once it is complete and on the disk.

    An existing file is replaced, unless the file must be `new`. Raises OSError with the path.
    """
    if new and (path.exists() or path.is_symlink()):
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(path))
    part = path.with_name(f".{path.name}.part")
    with named_errors(path):
        try:
            with part.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
        except OSError:
            with suppress(OSError):
                part.unlink()
            raise


@contextmanager
def named_errors(path: Path) -> Iterator[None]:
    """Raise OSError with a path: errors of an open file have none."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
