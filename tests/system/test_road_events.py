"""Real processes: a collision ends a run that allows none."""

import json
from pathlib import Path
from typing import Any

from tests.system.processes import run_to_the_end

BRAKING = """
name = "braking"
duration_s = 20.0
[convoy]
vehicles = 2
[path]
kind = "segments"
segments = [{ length_m = 500.0 }]
[speed]
lead = "profile"
followers = "gap"
profile = [{ at_s = 0.0, speed_mps = 25.0 }, { at_s = 1.0, speed_mps = 25.0 },
           { at_s = 4.0, speed_mps = 5.0 }]
[speed.gap]
standstill_m = 1.0
headway_s = 0.05
[control.degradation]
reaction = "extrapolate"    # who degrades does not collide
[links]
loss_ratio = 0.9
[limits]
collisions_max = 0
"""


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return found


def test_a_collision_ends_the_run_and_is_said_everywhere(tmp_path: Path) -> None:
    (tmp_path / "braking.toml").write_text(BRAKING)
    said = run_to_the_end("run", "braking.toml", "--out", "hit", folder=tmp_path)
    found = summary(tmp_path / "hit")
    (collision,) = [one for one in found["events"] if one["kind"] == "collision"]
    assert collision["vehicles"] == ["v1", "v2"]
    assert said.exit_code == 1
    assert found["outcome"] == "failed"
    assert found["reason"].startswith("limits.collisions_max = 0: collision: v2 and v1, closing")
    assert found["ran_s"] < 20.0
    assert "run: collision: v2 and v1, closing at " in said.err
    assert found["reason"] in said.out
    assert "events: " in said.out
