"""Failing user controllers in a convoy of processes: one line, no traceback."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.system.logs import Run, assert_sound
from tests.system.processes import run_to_the_end

NOT_A_NUMBER = "v3: controller 'own.ReturnsNan': steer() returned SteeringCommand(steering=nan"
CONTINUES = "; the convoy continues without it"

OWN = """
from vehicles.driver.steering import FeedforwardFeedback, SteeringCommand

class Raising(FeedforwardFeedback):
    left = 30
    def steer(self, errors, speed):
        self.left -= 1
        if not self.left:
            raise RuntimeError("no path")
        return super().steer(errors, speed)

class ReturnsNan(FeedforwardFeedback):
    left = 40
    def steer(self, errors, speed):
        self.left -= 1
        return super().steer(errors, speed) if self.left else SteeringCommand(float("nan"), 0, 0)

class Other(FeedforwardFeedback):
    def __init__(self, parameters):
        pass
"""
RAISED = "v2: controller 'own.Raising': steer() raised RuntimeError: no path (own.py, line 9), "


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working folder with the module `own`."""
    (tmp_path / "own.py").write_text(OWN, encoding="utf-8")
    return tmp_path


def arguments(*settings: str, out: str = "run", duration_s: float = 1.5) -> Sequence[str]:
    """Arguments of a run of three vehicles with `settings`."""
    fixed = ("run", "lane_change", "--set=convoy.vehicles=3", f"--set=duration_s={duration_s}")
    return (*fixed, *(f"--set={setting}" for setting in settings), "--out", out)


def controlled(vehicle: str, name: str) -> str:
    return f"vehicle.{vehicle}.control.controller=own.{name}"


def test_a_controller_that_raises_ends_the_run(folder: Path) -> None:
    ran = run_to_the_end(*arguments(controlled("v2", "Raising")), "--quiet", folder=folder)
    assert ran.exit_code == 1
    (line,) = ran.lines()
    assert line == f"{RAISED}0.58 s after the start"
    run = Run(folder / "run")
    assert_sound(run.log)
    assert (run.summary["outcome"], run.summary["reason"]) == ("failed", line)


def test_a_controller_with_a_wrong_constructor_is_refused_before_the_start(
    folder: Path,
) -> None:
    ran = run_to_the_end(*arguments(controlled("v2", "Other")), folder=folder)
    assert ran.exit_code == 2
    (line,) = ran.lines()
    assert "'own.Other' cannot be built as Other(parameters, gains, …): TypeError" in line
    assert not (folder / "run").exists()


def test_a_convoy_continues_without_failed_controllers(folder: Path) -> None:
    settings = (
        *(controlled("v2", "Raising"), controlled("v3", "ReturnsNan")),
        "convoy.on_vehicle_failure=continue",
    )
    wall = run_to_the_end(*arguments(*settings), folder=folder)
    virtual = run_to_the_end(*arguments(*settings, out="virtual"), "--clock=virtual", folder=folder)
    for ran, folder_name in ((wall, "run"), (virtual, "virtual")):
        assert ran.exit_code == 0, ran.err
        vehicle_lines = [line for line in ran.lines() if line.startswith(("v", "run: v"))]
        first, second, *left = sorted(vehicle_lines, key=lambda line: line.startswith("run: "))
        assert first.startswith(RAISED)
        assert second.startswith(NOT_A_NUMBER)
        assert [line[:12] for line in left] == ["run: v2 left", "run: v3 left"]
        assert all(line.endswith(CONTINUES) for line in left)
        assert "Traceback" not in ran.err
        run = Run(folder / folder_name)
        assert_sound(run.log)
        assert run.summary["outcome"] == "completed"
        assert [len(poses) for poses in run.truths.values()] == [75, 29, 39]
