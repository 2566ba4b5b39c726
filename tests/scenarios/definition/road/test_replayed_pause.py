"""Drives with a pause of hours."""

from pathlib import Path

import numpy as np
import pytest

from scenarios.definition.check.findings import report_of
from scenarios.definition.road.lead_speed import recorded
from scenarios.definition.scenario import scenario_from_text

PAUSE_S = 72_000.0


def test_a_pause_of_hours_takes_few_knots_and_no_distance(tmp_path: Path) -> None:
    """300 m at 10 m/s, 20 h at one place, and 300 m more."""
    lines = ["t_s,x_m,y_m"]
    for k in range(601):
        at = 0.1 * k + (PAUSE_S if k > 300 else 0.0)
        lines.append(f"{at:.1f},{float(k)},{20.0 * np.sin(k / 200.0):.3f}")
    (tmp_path / "a.csv").write_text("\n".join(lines))
    text = 'name = "a"\n[path]\nkind = "trace"\nfile = "a.csv"\n[speed]\nlead = "recorded"\n'
    text += '[vehicle.v2]\nreplay = "a.csv"\nreplay_offset_s = 2.0\n'
    scenario = scenario_from_text(text, folder=tmp_path)
    drive = scenario.replays["v2"]
    assert len(drive.times) < 1000
    stations = [drive.at(at - drive.begun)[2] for at in (10.0, 36_000.0, PAUSE_S + 50.0)]
    assert stations == pytest.approx([100.0, 300.5, 500.0], abs=4.0)
    speeds = [drive.at(at - drive.begun)[1] for at in (10.0, 36_000.0, PAUSE_S + 50.0)]
    assert speeds == pytest.approx([10.0, 0.0, 10.0], abs=0.2)
    # Both wait at the same place.
    assert any("overlap" in line for line in report_of(scenario).warnings)


@pytest.mark.parametrize("speeds", [(), [10.0] * 600], ids=["by times", "by speeds"])
def test_a_recorded_pause_of_hours_takes_few_knots(speeds: list[float]) -> None:
    times = [0.1 * k + (PAUSE_S if k > 300 else 0.0) for k in range(600)]
    profile, _ = recorded(times, [float(k) for k in range(600)], speeds)
    assert len(profile.times) < 1000
    assert profile.distance(PAUSE_S + 59.9) == pytest.approx(599.0, abs=2.0)
    expected = [10.0, 0.0, 0.0, 10.0]
    assert [profile.at(at)[0] for at in (10.0, 40.0, 36_000.0, PAUSE_S + 50.0)] == pytest.approx(
        expected, abs=0.1
    )
