"""A controller of the user's own that fails ends the run, which says who, when and why."""

from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual import run_virtual
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.driver.steering import FeedforwardFeedback, SteeringCommand
from vehicles.driver.tracking import TrackingErrors


class Failing(FeedforwardFeedback):
    """Steers fifty times, then divides by zero."""

    left = 50

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        self.left -= 1
        return super().steer(errors, speed / 1.0 if self.left else 1 / self.left)


class Dizzy(Failing):
    """Steers fifty times, then gives no number."""

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        self.left -= 1
        command = FeedforwardFeedback.steer(self, errors, speed)
        return command if self.left else SteeringCommand(float("nan"), 0.0, 0.0)


class Raising(FeedforwardFeedback):
    """Cannot be built."""

    def __init__(self, parameters: VehicleParameters, gains: Gains) -> None:  # noqa: ARG002
        raise RuntimeError("of two\nlines")


class Mistaken(FeedforwardFeedback):
    """Returns what is no command."""

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        return super().steer(errors, speed).steering  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Failing", "steer() raised ZeroDivisionError: division by zero"),
        ("Dizzy", "steer() returned steering = nan, needed is a finite number of radians"),
    ],
)
def test_a_controller_that_fails_in_mid_run_fails_the_run(
    name: str, why: str, tmp_path: Path
) -> None:
    own = f"vehicle.v2.control.controller={__name__}.{name}"
    stop = Stop()
    summary = run_virtual(load_scenario("lane_change", ["duration_s=2", own]), tmp_path, stop)
    expected = f"v2: controller '{__name__}.{name}': {why}, 0.98 s after the start"
    assert (summary.outcome, summary.reason) == ("failed", expected)
    assert stop.exit_code == EXIT_FAILED
    assert summary.ran_s == pytest.approx(0.98)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Raising", "cannot be built as Raising(parameters, gains): RuntimeError: of two lines"),
        ("Mistaken", "steer() returned float, needed is a SteeringCommand"),
    ],
)
def test_a_controller_that_cannot_steer_is_refused_before_the_run(name: str, why: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        load_scenario("lane_change", [f"control.controller={__name__}.{name}"])
    (line,) = refused.value.lines
    assert line.startswith(f"--set: control.controller: controller '{__name__}.{name}': {why}")
