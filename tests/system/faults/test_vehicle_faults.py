"""Scheduled vehicle faults act alike in real processes and in virtual time, bit for bit."""

import json
from pathlib import Path

import pytest

from tests.system.logs import Run, assert_equal_while_nothing_was_late, assert_sound
from tests.system.processes import invoke, run_to_the_end, start
from vehicles.messages import Change, GpsPose, LogText

FAULTS = """
extends = "lane_change"
name = "faults"
duration_s = 9.0
[convoy]
vehicles = 5
[links]
latency_ms = 100.0          # includes the network
loss = { kind = "gilbert_elliott", loss_ratio = 0.1, burst_messages_mean = 3.0 }
[vehicle.v2.clock]
offset_ms = -40.0
drift_ppm = 200.0
[[change]]
kind = "stall"
at_s = 1.0
vehicle = "v2"
for_s = 0.31
[[change]]
kind = "gnss"
at_s = 1.503
vehicle = "v1"
fix = "float"
for_s = 1.0
[[change]]
kind = "speed"
at_s = 2.0
speed_mps = 25.0
[[change]]
kind = "join"
at_s = 2.51
vehicle = "v5"
[[change]]
kind = "crash"
at_s = 3.005
vehicle = "v3"
for_s = 3.5
[[change]]
kind = "leave"
at_s = 5.0
vehicle = "v4"
"""
RESTART_S = 6.505
PERMANENT_CRASH = """
extends = "lane_change"
name = "permanent_crash"
duration_s = 3.0
[[change]]
kind = "crash"
at_s = 1.5
vehicle = "v3"
"""


def changes(run: Run) -> list[tuple[str, int, str]]:
    """Vehicle, instant (ns after the start) and table of each change."""
    return sorted(
        (m.vehicle, m.effective_at_ns - run.start_at, m.table)
        for m in run.messages
        if isinstance(m, Change)
    )


def sent(run: Run, vehicle: str) -> list[tuple[int, int]]:
    """Numbers and instants (ns after the start) of the poses of a vehicle."""
    return [
        (m.seq, m.sent_at_ns - run.start_at)
        for m in run.messages
        if isinstance(m, GpsPose) and m.vehicle == vehicle
    ]


@pytest.fixture(scope="module")
def faulty_runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Run]:
    """Runs on both clocks."""
    folder = tmp_path_factory.mktemp("faults")
    (folder / "faults.toml").write_text(FAULTS)
    with start("run", "faults.toml", "--quiet", "--out=wall", folder=folder) as convoy:
        assert convoy.wait() == 0, convoy.err
        assert not convoy.remaining()
    virtual = invoke(
        "run", "faults.toml", "--clock=virtual", "--quiet", "--out=virtual", folder=folder
    )
    assert virtual.exit_code == 0, virtual.output
    return Run(folder / "wall"), Run(folder / "virtual")


def test_processes_and_virtual_time_agree_until_a_late_message(
    faulty_runs: tuple[Run, Run],
) -> None:
    wall, virtual = faulty_runs
    assert_equal_while_nothing_was_late(wall, virtual, within_m=0.5)
    assert {name: len(poses) for name, poses in wall.truths.items()} == dict.fromkeys(
        ("v1", "v2", "v3", "v4", "v5"), 450
    )
    assert changes(wall) == changes(virtual)
    kinds = [json.loads(table)["kind"] for _, _, table in changes(wall)]
    assert sorted(kinds) == ["crash", "gnss", "join", "leave", *["speed"] * 5, "stall"]
    for name in wall.truths:
        assert sent(wall, name) == sent(virtual, name), name
    assert wall.summary["recorder_rejected_messages"] == {}
    assert not any(row["missing_poses"] for row in wall.summary["vehicles"])
    assert_sound(wall.log)


def test_a_crashed_process_is_replaced(
    faulty_runs: tuple[Run, Run],
) -> None:
    wall, _ = faulty_runs
    numbers = [number for number, _ in sent(wall, "v3")]
    assert numbers == list(range(len(numbers)))
    assert not [at for _, at in sent(wall, "v3") if 3.02e9 <= at < RESTART_S * 1e9]
    assert any("its software has restarted" in text for text in wall.texts("v3"))


@pytest.mark.parametrize("on_failure", ["end", "continue"])
def test_a_permanent_crash_ends_or_leaves_the_run(on_failure: str, tmp_path: Path) -> None:
    (tmp_path / "permanent_crash.toml").write_text(PERMANENT_CRASH)
    common = (
        "run",
        "permanent_crash.toml",
        "--quiet",
        f'--set=convoy.on_vehicle_failure="{on_failure}"',
    )
    wall = run_to_the_end(*common, "--out=wall", folder=tmp_path)
    virtual = invoke(*common, "--clock=virtual", "--out=virtual", folder=tmp_path)
    line = "its process has crashed, as requested, 1.50 s after the start"
    assert wall.exit_code == virtual.exit_code == (1 if on_failure == "end" else 0), wall.err
    if on_failure == "end":
        assert f"v3: {line}" in wall.err
        assert f"v3: {line}" in virtual.stderr
    runs = Run(tmp_path / "wall"), Run(tmp_path / "virtual")
    for run in runs:
        assert max(run.truths["v3"]) < 1.5e9
    if on_failure == "continue":
        for run in runs:
            fatal = [m.text for m in run.messages if isinstance(m, LogText) and m.level == "fatal"]
            assert fatal == [line]
        assert_equal_while_nothing_was_late(*runs, within_m=0.5)
