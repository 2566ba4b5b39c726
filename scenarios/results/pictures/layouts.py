"""Layouts with which Foxglove and Rerun show the log of a run without this project."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import TimeoutExpired

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME, write_whole
from scenarios.results.pictures.run_drawing import widest_spacing
from scenarios.results.stream import sizes_of
from transport.log.foxglove_layout import foxglove_layout
from transport.picture.viewer_process import start_log_layout

FOXGLOVE_NAME, RERUN_NAME = "foxglove.json", "rerun.rbl"
LAYOUT_S = 10.0
"""Longest wait for the layout after a run; on an idle core it takes half a second."""


def write_foxglove_layout(folder: Path, scenario: Scenario) -> None:
    """Write a layout next to the log of a run of `scenario`, unless there is one.

    Nothing depends on it, so errors such as a full disk are ignored.
    """
    with suppress(OSError):
        layout = foxglove_layout(scenario.vehicle_names)
        write_whole(folder / FOXGLOVE_NAME, layout.encode(), new=True)


@contextmanager
def rerun_layout(folder: Path, scenario: Scenario) -> Iterator[None]:
    """Write a layout of Rerun next to the log of a run of `scenario`, unless there is one.

    Another process writes it while the context is active.
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
