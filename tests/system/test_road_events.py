"""Real processes: a collision ends a run that allows none, and a stalled recorder leaves a hole."""

import json
import time
from pathlib import Path
from typing import Any

from tests.system.processes import run_to_the_end, start

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
standstill_m = 6.0
headway_s = 0.05
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
    assert f"ended early: {found['reason']}" in said.out
    assert "events: " in said.out


def test_a_recorder_that_stood_still_names_what_it_missed(tmp_path: Path) -> None:
    """And makes no error of it: the lane change goes on meanwhile."""
    with start(
        "run", "lane_change", "--set=duration_s=12", "--out=stalled", folder=tmp_path
    ) as run:
        recorder = run.part("recorder")
        run.drive(4.0)
        recorder.suspend()
        time.sleep(4.0)
        recorder.resume()
        assert run.wait() == 0, run.err
    found = summary(tmp_path / "stalled")
    missing = {row["name"]: row["missing_poses"] for row in found["vehicles"]}
    holes = dict.fromkeys(missing, 0)
    for hole in found["holes"]:
        holes[hole["vehicle"]] += hole["poses"]
        assert 0.0 <= hole["from_s"] <= hole["to_s"] < 12.0
    assert holes == missing
    for row in found["vehicles"]:
        assert row["poses"] + row["missing_poses"] == 240
        if row["role"] == "follower":
            assert row["cross_track_error_m_max"] < 0.2
    if any(missing.values()):  # how much a router keeps for a recorder that stalls is its own
        assert "not recorded: " in run.out
        assert "the figures are of what was recorded" in run.out
