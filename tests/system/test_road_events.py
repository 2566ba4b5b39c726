"""In a run of real processes, a collision ends a run that allows none."""

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
reaction = "extrapolate"    # a follower that degrades does not collide
[links]
loss_ratio = 0.9
[limits]
collisions_max = 0
"""


def summary(folder: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return values


def test_a_collision_ends_the_run_and_is_reported(tmp_path: Path) -> None:
    (tmp_path / "braking.toml").write_text(BRAKING)
    done = run_to_the_end("run", "braking.toml", "--out", "hit", folder=tmp_path)
    result = summary(tmp_path / "hit")
    (collision,) = [event for event in result["events"] if event["kind"] == "collision"]
    assert collision["vehicles"] == ["v1", "v2"]
    assert done.exit_code == 1
    assert result["outcome"] == "failed"
    assert result["reason"].startswith("limits.collisions_max = 0: collision: v2 and v1, closing")
    assert result["ran_s"] < 20.0
    assert "run: collision: v2 and v1, closing at " in done.err
    assert result["reason"] in done.out
    assert "events: " in done.out
