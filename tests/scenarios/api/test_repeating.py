"""Replay from Python."""

from pathlib import Path

import pytest

import scenarios.api as convoy


def test_a_log_is_replayed(tmp_path: Path) -> None:
    settings = {"duration_s": 0.6, "convoy.vehicles": 3}
    first = convoy.run("lossy_lane_change", set=settings, out=tmp_path / "first")
    again = convoy.replay(first, ["v1"], out=tmp_path / "again")
    assert again.summary.outcome == "completed"
    assert again.vehicles["v3"].true.error_m.tolist() == first.vehicles["v3"].true.error_m.tolist()
    with pytest.raises(convoy.Error, match='given "v9"'):
        convoy.replay(first, ["v9"])
