"""Layouts by which other programs show a log of a run as it should be."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import TimeoutExpired

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.pictures.run_drawing import widest_spacing
from scenarios.results.stream import sizes_of
from transport.log.foxglove_layout import foxglove_layout
from transport.picture.viewer_process import start_log_layout

FOXGLOVE_NAME, RERUN_NAME = "foxglove.json", "rerun.rbl"
"""Layouts for whoever opens the log without this project."""
LAYOUT_S = 10.0
"""How long a run that is over waits at most for its layout: half a second where a core is idle."""


def write_foxglove_layout(folder: Path, scenario: Scenario) -> None:
    """Write a layout for the log of a run of `scenario` beside it, if there is room and no other.

    It takes no part in the run, so nothing depends on it.
    """
    with suppress(OSError), (folder / FOXGLOVE_NAME).open("x", encoding="utf-8") as file:
        file.write(foxglove_layout(scenario.vehicle_names))


@contextmanager
def rerun_layout(folder: Path, scenario: Scenario) -> Iterator[None]:
    """Write a layout of Rerun for the log of a run of `scenario` beside it, if there is no other.

    That takes half a second, during which others go on.
    """
    path = folder / RERUN_NAME
    if path.exists() or path.is_symlink():
        yield
        return
    writer = start_log_layout(
        path,
        log=Path(LOG_NAME).stem,
        cars=sizes_of(scenario),
        spacing_m=widest_spacing(scenario),
    )
    try:
        yield
        with suppress(TimeoutExpired):
            writer.wait(LAYOUT_S)
    finally:
        writer.kill()
        writer.wait()
        path.with_name(f"{path.name}.part").unlink(missing_ok=True)
        if not (folder / LOG_NAME).exists():  # there was no run
            path.unlink(missing_ok=True)
