"""How commands fail: one clear line for each problem, an exit code, no traceback."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec

import click

from scenarios.definition.errors import ScenarioError
from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED
from transport.bus.bus import BusError
from transport.log.records import LogError
from transport.picture.viewer_process import ViewerError

UNWRITABLE = {errno.EACCES, errno.EDQUOT, errno.EIO, errno.ENOSPC, errno.EPERM, errno.EROFS}
"""Faults of the destination, not of the input."""


class MissingExtraError(Exception):
    """A missing optional package, in one line."""


def require(what: str, extra: str, *packages: str) -> None:
    """Raise MissingExtraError if a package of `extra` that `what` needs is missing."""
    missing = [package for package in packages if find_spec(package) is None]
    if missing:
        raise MissingExtraError(
            f"{what}: needs {' and '.join(missing)}, not installed here: "
            f"pip install 'convoy-emulator[{extra}]'"
        )


@contextmanager
def clear_errors() -> Iterator[None]:
    """Turn errors in the input into lines on standard error and an exit code."""
    exit_code = EXIT_BAD_INPUT
    try:
        yield
    except (ScenarioError, BusError, LogError, ViewerError, MissingExtraError) as error:
        for line in str(error).splitlines():
            click.echo(line, err=True)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        click.echo(f"{where}{(error.strerror or str(error)).lower()}", err=True)
        if error.errno in UNWRITABLE:
            exit_code = EXIT_FAILED
    else:
        return
    raise SystemExit(exit_code)
