"""Failing user controllers in a convoy of processes: one line, no traceback."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.system.logs import Run, assert_sound
from tests.system.processes import run_to_the_end

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
RAISED = "v2: controller 'own.Raising': steer() raised RuntimeError: no path, "


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
    assert "'own.Other': cannot be built as Other(parameters, gains): TypeError" in line
    assert not (folder / "run").exists()
