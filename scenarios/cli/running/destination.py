"""Checks of the destination of a run's picture."""

from pathlib import Path

from scenarios.definition.errors import require
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from transport.picture.option import parse_rerun_option, refuse_foreign_file, spelled
from transport.picture.viewer_process import ViewerError, require_display


def refuse_picture(rerun: str, out: Path | None) -> None:
    """Raise ViewerError if a run into `out` cannot draw at the requested destination."""
    option = parse_rerun_option(rerun)
    if option.sink != "off":
        require(spelled(rerun), "viewer", "rerun")
    if option.sink == "spawn":
        require_display()
    refuse_foreign_file(option)
    own = [(out / name).resolve() for name in (LOG_NAME, SUMMARY_NAME)] if out else []
    if option.sink == "save" and Path(option.target).resolve() in own:
        raise ViewerError(f"{spelled(rerun)}: the run writes this file itself; give another one")
