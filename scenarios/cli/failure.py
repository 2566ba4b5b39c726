"""How commands fail: one clear line for each problem, an exit code, no traceback."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from scenarios.definition.errors import ScenarioError
from scenarios.runs.stop import EXIT_BAD_INPUT
from transport.bus.bus import BusError
from transport.log.records import LogError
from transport.picture.viewer_process import ViewerError


@contextmanager
def clear_errors() -> Iterator[None]:
    """Turn the errors that a user can do something about into lines and an exit code."""
    try:
        yield
    except (ScenarioError, BusError, LogError, ViewerError) as error:
        for line in str(error).splitlines():
            click.echo(line, err=True)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        click.echo(f"{where}{(error.strerror or str(error)).lower()}", err=True)
    else:
        return
    raise SystemExit(EXIT_BAD_INPUT)
