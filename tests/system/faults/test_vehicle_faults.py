"""What is done to vehicles by schedule: real processes do what virtual time does, bit for bit."""

import json
from pathlib import Path

import psutil
import pytest

from tests.system.logs import Run, assert_equal_while_nothing_was_late, assert_sound
from tests.system.processes import run_to_the_end, start, until
from vehicles.messages import Change, GpsPose, LogText

FAULTS = """
extends = "lane_change"
name = "faults"
duration_s = 9.0
[convoy]
vehicles = 5
[links]
latency_ms = 100.0          # of which the wire takes a few
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
BACK_S = 6.505
DEATH = """
extends = "lane_change"
name = "death"
duration_s = 3.0
[[change]]
kind = "crash"
at_s = 1.5
vehicle = "v3"
"""


def changes(run: Run) -> list[tuple[str, int, str]]:
    """Who carried out what, in ns after the start."""
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
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Run, list[str]]:
    """Wall clock and virtual time, and what was seen of the process that crashes."""
    folder = tmp_path_factory.mktemp("faults")
    (folder / "faults.toml").write_text(FAULTS)
    seen: list[str] = []
    with start("run", "faults.toml", "--quiet", "--out=wall", folder=folder) as said:
        third = said.part("v3")
        environment = Path(f"/proc/{third.pid}/environ")

        def started_anew() -> bool:
            return environment.exists() and b"CONVOY_HANDOVER=" in environment.read_bytes()

        if until(lambda: started_anew() or said.exit_code is not None) and started_anew():
            seen.append(psutil.Process(third.pid).name())
        assert said.wait() == 0, said.err
        assert not said.everyone()
    virtual = run_to_the_end(
        "run", "faults.toml", "--clock=virtual", "--quiet", "--out=virtual", folder=folder
    )
    assert virtual.exit_code == 0, virtual.err
    return Run(folder / "wall"), Run(folder / "virtual"), seen


def test_processes_and_virtual_time_agree_until_something_came_late(
    driven: tuple[Run, Run, list[str]],
) -> None:
    wall, virtual, _ = driven
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


def test_the_process_that_crashed_has_really_been_another_one_since(
    driven: tuple[Run, Run, list[str]],
) -> None:
    wall, _, seen = driven
    assert seen, "no process was seen that had been handed over anything"
    numbers = [number for number, _ in sent(wall, "v3")]
    assert numbers == list(range(len(numbers)))  # they go on
    assert not [at for _, at in sent(wall, "v3") if 3.02e9 <= at < BACK_S * 1e9]
    assert any("its software has restarted" in text for text in wall.texts("v3"))


@pytest.mark.parametrize("when", ["end", "continue"])
def test_a_process_that_does_not_come_back_ends_with_its_fault(when: str, tmp_path: Path) -> None:
    (tmp_path / "death.toml").write_text(DEATH)
    common = ("run", "death.toml", "--quiet", f'--set=convoy.on_vehicle_failure="{when}"')
    said = run_to_the_end(*common, "--out=wall", folder=tmp_path)
    virtual = run_to_the_end(*common, "--clock=virtual", "--out=virtual", folder=tmp_path)
    line = "its process has crashed, as requested, 1.50 s after the start"
    assert said.exit_code == virtual.exit_code == (1 if when == "end" else 0), said.err
    if when == "end":
        assert f"v3: {line}" in said.err
        assert f"v3: {line}" in virtual.err
    runs = Run(tmp_path / "wall"), Run(tmp_path / "virtual")
    for run in runs:
        assert max(run.truths["v3"]) < 1.5e9
    if when == "continue":
        for run in runs:
            fatal = [m.text for m in run.messages if isinstance(m, LogText) and m.level == "fatal"]
            assert fatal == [line]
        assert_equal_while_nothing_was_late(*runs, within_m=0.5)
