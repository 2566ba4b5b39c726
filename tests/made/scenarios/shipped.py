"""Scenarios that ship, driven to their end in virtual time once for all tests of a session."""

from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual.logged_run import run_virtual
from tests.made.once import first_only, shared


def driven_to_its_end(name: str, factory: pytest.TempPathFactory) -> Path:
    """Return the folder with the log and the summary of a whole run of a scenario that ships."""
    folder = shared(factory) / f"shipped-{name}"
    with first_only(folder) as first:
        if first:
            run_virtual(load_scenario(name), folder / "run", Stop())
    return folder / "run"
