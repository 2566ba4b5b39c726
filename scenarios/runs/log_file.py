"""How the log of a run begins."""

from pathlib import Path

from scenarios.definition.scenario import Scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.stream import sizes_of
from transport.log.scene import Scene
from transport.log.writer import LogWriter


def log_writer(scenario: Scenario, folder: Path) -> LogWriter:
    """Begin the log of a run of `scenario` in `folder`, which is made; raises LogError."""
    folder.mkdir(parents=True, exist_ok=True)
    rates_hz = scenario.tables.log.rates_hz
    return LogWriter(folder / LOG_NAME, scene=scene_of(scenario), rates_hz=rates_hz)


def scene_of(scenario: Scenario) -> Scene:
    """Say what a run of `scenario` looks like, for its log."""
    path = scenario.route.path
    lane = scenario.tables.events.lane_width_m
    return Scene(sizes_of(scenario), (path.east.tolist(), path.north.tolist()), lane)
