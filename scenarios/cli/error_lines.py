"""Errors of commands: `error: where: what, what is allowed`, and an exit code."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager

import click

from scenarios.runs.stop import EXIT_BAD_INPUT, EXIT_FAILED
from transport.log.errors import UnwritableError
from transport.picture.viewer_process import UnwritableRecordingError
from transport.texts import ConvoyError

UNWRITABLE = {errno.EACCES, errno.EDQUOT, errno.EIO, errno.ENOSPC, errno.EPERM, errno.EROFS}
"""Faults of the destination, not of the input."""


def error_line(text: str) -> str:
    return f"error: {text}"


def print_error(text: str) -> None:
    for line in text.splitlines():
        click.echo(error_line(line), err=True)


@contextmanager
def clear_errors() -> Iterator[None]:
    """Print errors in the input to standard error and exit with their code."""
    exit_code = EXIT_BAD_INPUT
    try:
        yield
    except ConvoyError as error:
        print_error(str(error))
        if isinstance(error, UnwritableError | UnwritableRecordingError):
            exit_code = EXIT_FAILED
    except OSError as error:
        place = f"{error.filename}: " if error.filename else ""
        print_error(f"{place}{(error.strerror or str(error)).lower()}")
        if error.errno in UNWRITABLE:
            exit_code = EXIT_FAILED
    else:
        return
    raise SystemExit(exit_code)


def warn_of_log(faults: str) -> None:
    """Print damage and holes of a log, if any, to standard error."""
    if faults:
        click.echo(f"warning: {faults}", err=True)
