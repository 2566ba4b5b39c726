"""Vehicles that move as they were recorded: their receivers change, and their clocks are off."""

from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.convoys.changed_convoys import ChangedConvoy
from tests.made.scenarios.rough_drives import FORMATS, SUFFIXES, SWEEP, Rough, text_of
from vehicles.messages import Change, GpsPose, Tracking, TruePose

LEAD = Rough(course=SWEEP, speed=15.0, form="gpx")


def with_recorded(folder: Path, rest: str) -> Scenario:
    """The second vehicle is the lead's car again, a second behind it."""
    second = [(t + 1.0, e, n, v) for t, e, n, v in LEAD.points()]
    name = f"second.{SUFFIXES[LEAD.form]}"
    (folder / name).write_bytes(FORMATS[LEAD.form](second))
    text = text_of(LEAD, folder, "duration_s = 6.0\n")
    return scenario_from_text(f'{text}[vehicle.v2]\nreplay = "{name}"\n{rest}', folder=folder)


def test_its_receiver_changes_and_its_clock_is_off(tmp_path: Path) -> None:
    change = '[[change]]\nkind = "gnss"\nvehicle = "v2"\nat_s = 2.0\nfor_s = 1.0\nfix = "float"\n'
    calm = ChangedConvoy(with_recorded(tmp_path, "")).run()
    run = ChangedConvoy(
        with_recorded(tmp_path, f"[vehicle.v2.clock]\noffset_ms = -200.0\n{change}")
    ).run()
    poses = run.of("v2", GpsPose)
    floating = [one for one in poses if one.fix == "float"]
    assert [one.sent_at_ns - run.start_at for one in floating] == [
        2_000_000_000 + k * 50_000_000 for k in range(20)
    ]
    assert {one.measured_at_ns - one.sent_at_ns for one in poses} == {-200_000_000}
    assert [one.kind for one in run.of("v2", Change)] == ["gnss"]
    assert run.of("v2", TruePose) == calm.of("v2", TruePose)
    older = run.of("v3", Tracking)[50].predecessor_age_s
    assert older == pytest.approx(calm.of("v3", Tracking)[50].predecessor_age_s + 0.2, abs=1e-6)


def test_changes_of_software_are_refused_for_a_replay(tmp_path: Path) -> None:
    change = '[[change]]\nkind = "stall"\nvehicle = "v2"\nat_s = 2.0\nfor_s = 1.0\n'
    with pytest.raises(ScenarioError, match="replays a drive, allowed only kind"):
        with_recorded(tmp_path, change)
