"""Any good drive spoiled by any faults is driven like the good one, or states what it lacks."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import event, given
from scipy.spatial import cKDTree

from scenarios.definition.errors import ScenarioError
from tests.made.examples import examples
from tests.made.spoiled.drawn_drives import SpoiledDrive, spoiled_drives
from tests.made.spoiled.driven_paths import (
    Driven,
    Floats,
    distances,
    driven,
    lost_points,
    written,
)
from tests.made.spoiled.record_faults import UNTIMED
from tests.made.spoiled.synthetic_drives import Recording

CLOSE = 0.3
"""Largest distance (m) of both paths; noise adds to it."""


def unspoiled(case: SpoiledDrive, folder: Path, lead: str, path: str) -> Driven | None:
    """Drive the good file; None if noise makes a path that no car can drive."""
    try:
        name = written(folder, f"good{case.suffix}", case.good())
        return driven(folder, name, lead=lead, path=path)
    except ScenarioError:
        assert case.drive.noise > 0.3
        return None


def without_source(path: Floats, places: Floats, reach: float) -> Floats:
    """Mark the points of a path further than `reach` (m) from all places."""
    if not places.size:
        return np.ones(path.shape[1], dtype=bool)
    return np.asarray(cKDTree(places).query(path.T)[0] > reach)


def lost_places(case: SpoiledDrive, recording: Recording, spoiled: Driven) -> Floats:
    """Positions in the good drive of all records that are not among the points driven."""
    good = case.drive.recorded()
    lost = {*lost_points(spoiled, case.drive)} | {k for k in recording.may_lack if k >= 0}
    return np.array([(good.fixes[k].east, good.fixes[k].north) for k in sorted(lost)])


@examples(8, 300)
@given(case=spoiled_drives())
def test_a_spoiled_drive_is_the_good_drive(case: SpoiledDrive) -> None:
    recording, data = case.file()
    lead = "recorded" if recording.timed and case.form not in UNTIMED else "set"
    path = 'pauses = "cut"' if recording.added_s else ""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        good = unspoiled(case, folder, lead, path)
        if good is None:
            event("noise makes no path")
            return
        spoiled = driven(
            folder,
            written(folder, f"spoiled{case.suffix}", data),
            lead=lead,
            path=path,
        )
    lost = lost_places(case, recording, spoiled)
    spacing = case.drive.speed / case.drive.rate_hz
    reach = 3.0 * spacing + 2.0 * max(good.table.smoothing_m, spoiled.table.smoothing_m)
    for one, other in ((good.path, spoiled.path), (spoiled.path, good.path)):
        off = distances(one, other)[without_source(one, lost, reach)]
        assert np.nanmax(off, initial=0.0) < CLOSE + case.drive.noise

    missing = {*lost_points(spoiled, case.drive, recording)} - {*lost_points(good, case.drive)}
    assert len(missing) <= 2 * len(recording.may_lack) + 0.05 * len(recording.fixes) + 2
    if missing:
        assert spoiled.report.warnings
    if lead == "recorded":
        seconds = (len(recording.may_lack) + len(missing)) / case.drive.rate_hz
        if recording.added_s:  # a pause at a stop leaves out more or less of it
            seconds += sum(wait for _, wait in case.drive.stops)
        assert spoiled.scenario.duration_s == pytest.approx(
            good.scenario.duration_s, abs=seconds + 2.0 + 2.0 / case.drive.rate_hz
        )
