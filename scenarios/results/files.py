"""The two files of a run's folder, results as JSON, and files that are written whole or not at all.

The summary of a run is also attached to its log.
"""

import errno
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import fields, is_dataclass
from math import isfinite
from pathlib import Path
from typing import Any, get_args

LOG_NAME = "run.mcap"
SUMMARY_NAME = "summary.json"


def plain(value: Any) -> Any:
    """Convert a result to JSON values: dataclasses and models to tables, NaN and ±inf to null."""
    if hasattr(value, "model_dump"):
        value = value.model_dump(mode="json")
    elif hasattr(value, "tolist"):
        value = value.tolist()
    elif is_dataclass(value):
        value = {one.name: _of_type(one.type, getattr(value, one.name)) for one in fields(value)}
    if isinstance(value, Mapping):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(entry) for entry in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _of_type(kind: Any, value: Any) -> Any:
    """A whole number in a field of numbers is one of them: 1 and 1.0 are written alike."""
    is_float = kind is float or float in get_args(kind)
    return float(value) if type(value) is int and is_float else value


def json_text(value: Any) -> str:
    """Text of a result as JSON, with a newline at its end."""
    return json.dumps(plain(value), indent=2, allow_nan=False) + "\n"


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
