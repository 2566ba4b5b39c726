"""Whole virtual runs of shipped scenarios, simulated once per test session."""

from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.once import first_only, shared

SHORTER = {"church_lot": ["duration_s=45"]}
"""More than a lap."""


def whole_run(name: str, factory: pytest.TempPathFactory) -> Path:
    folder = shared(factory) / f"shipped-{name}"
    with first_only(folder) as first:
        if first:
            run_virtual(load_scenario(name, SHORTER.get(name, ())), folder / "run", Stop())
    return folder / "run"
