"""The layout with which Foxglove shows the log of a run without this project."""

from contextlib import suppress
from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.files import write_whole
from transport.log.foxglove_layout import foxglove_layout

FOXGLOVE_NAME = "foxglove.json"


def write_foxglove_layout(folder: Path, scenario: Scenario) -> None:
    """Write a layout next to the log of a run of `scenario`, unless there is one.

    Nothing depends on it, so errors such as a full disk are ignored.
    """
    with suppress(OSError):
        layout = foxglove_layout(scenario.vehicle_names)
        write_whole(folder / FOXGLOVE_NAME, layout.encode(), new=True)
