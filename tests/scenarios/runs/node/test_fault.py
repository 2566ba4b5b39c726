"""A failing controller of the user ends the run with vehicle, time and reason."""

import sys
from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual import run_virtual
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


class Leaving(Failing):
    """Steers fifty times, then ends its process, as scripts do that meet an error."""

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        self.left -= 1
        if not self.left:
            sys.exit(3)
        return FeedforwardFeedback.steer(self, errors, speed)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("Failing", "steer() raised ZeroDivisionError: division by zero"),
        ("Leaving", "steer() raised SystemExit: 3"),
        ("Dizzy", "steer() returned SteeringCommand(steering=nan"),
    ],
)
def test_a_controller_that_fails_in_mid_run_fails_the_run(
    name: str, why: str, tmp_path: Path
) -> None:
    own = f"vehicle.v2.control.controller={__name__}.{name}"
    stop = Stop()
    summary = run_virtual(load_scenario("lane_change", ["duration_s=2", own]), tmp_path, stop)
    assert summary.outcome == "failed"
    assert summary.reason.startswith(f"v2: controller '{__name__}.{name}': {why}")
    assert stop.exit_code == EXIT_FAILED
    assert summary.ran_s == pytest.approx(0.98)


def test_a_car_that_spins_ever_faster_fails_the_run(tmp_path: Path) -> None:
    unstable = [
        *("duration_s=60", "convoy.vehicles=2", "control.rate_hz=10", "gnss.rate_hz=5"),
        "vehicle.v2.parameters.rear_cornering_stiffness_n_per_rad=20000",
        'parameters.tyres="linear"',  # others only slide
    ]
    summary = run_virtual(load_scenario("lane_change", unstable[1:]), tmp_path, Stop())
    assert summary.outcome == "failed"
    assert summary.reason.startswith("v2: the car spins: it is unstable at 2")
