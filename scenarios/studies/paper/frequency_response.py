"""Frequency response of the emulated convoy, from fitted amplitudes behind a lead on a sine.

The closed forms are in `vehicles.theory.propagation`. In the paper's G(jω) a follower steers by the
difference of both cars' states at the same instant; in F(jω) it steers along its predecessor's
path.
"""

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.results.drives import Trial
from scenarios.runs.virtual.unlogged_run import drive_trial
from vehicles.preview.curve_fit import Trajectory

Array = NDArray[np.float64]

FREQUENCIES = (0.8, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Frequencies (rad/s) of the sine, from a slow lane change to beyond a car's bandwidth."""

SHORT_FREQUENCIES = FREQUENCIES[2:]
"""Frequencies simulated with the short preview; lower ones do not depend on the preview."""

PREVIEW_S = 0.8
SHORT_PREVIEW_S = 0.25
"""The paper's preview (s), and a short preview that smooths little."""

MAX_AMPLITUDE = 0.5
"""Limit of the lead's amplitude (m)."""

MAX_ACCELERATION = 1.5
"""Limit of the lead's lateral acceleration (m/s²)."""

PERIODS = 3
"""Number of evaluated periods."""

TRANSIENT = 4.0
"""Least time (s) before the evaluation, which is at least one period."""

SPACING = 0.5
"""Distance between the points of the lead's path (m)."""

STRAIGHT = 1.5
"""Time (s) on a straight before the sine begins."""

RISE = 2.0
"""Time (s) over which the sine grows to its amplitude."""


@dataclass(frozen=True)
class SineResponse:
    """Complex amplitude (m) of each vehicle's path at one frequency (rad/s), the lead first."""

    frequency: float
    preview_s: float
    amplitudes: tuple[complex, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        sizes = np.abs(self.amplitudes)
        return tuple((sizes[1:] / sizes[:-1]).tolist())


def drive_sine(
    frequency: float, preview_s: float = PREVIEW_S, trajectory: Trajectory = "fitted"
) -> SineResponse:
    """Simulate a convoy behind a lead on a sine of `frequency` (rad/s)."""
    scenario = sine_scenario(frequency, preview_s, trajectory)
    return SineResponse(frequency, preview_s, amplitudes(drive_trial(scenario), frequency))


def sine_scenario(
    frequency: float, preview_s: float = PREVIEW_S, trajectory: Trajectory = "fitted"
) -> Scenario:
    """The paper's base case with empty cars, no lead data, and a lead that drives a sine."""
    alone = (
        'information_flow.lateral="predecessor"',
        f'control.trajectory="{trajectory}"',
        "loading.front_passengers=0",
        "loading.rear_passengers=0",
    )
    base = load_scenario("paper_base", (*alone, f"control.preview_s={preview_s}"))
    speed = base.tables.speed.set_mps
    convoy = sum(base.route.spacings)
    transient = STRAIGHT + RISE + max(TRANSIENT, 2.0 * pi / frequency)
    duration = ceil(transient + PERIODS * 2.0 * pi / frequency + convoy / speed) + 1.0
    east = np.arange(0.0, speed * duration + 60.0, SPACING)
    since = east / speed - STRAIGHT
    rise = np.clip(since / RISE, 0.0, 1.0)
    height = min(MAX_AMPLITUDE, MAX_ACCELERATION / frequency**2) * rise * rise * (3.0 - 2.0 * rise)
    path = PointsPath(
        kind="points",
        source="sine",
        east_m=tuple(east.tolist()),
        north_m=tuple((height * np.sin(frequency * since)).tolist()),
        smoothing_m=2.0,
    )
    return Scenario(base.tables.model_copy(update={"path": path, "duration_s": duration}))


def amplitudes(trial: Trial, frequency: float) -> tuple[complex, ...]:
    """Fit a sine and a straight line to each vehicle's path by least squares (m).

    All paths are fitted over the same section of road, the last PERIODS that all vehicles drove.
    """
    speed = float(trial.lead.speed.mean())
    end = min(float(drive.east[-1]) for drive in trial.drives)
    begin = end - PERIODS * 2.0 * pi * speed / frequency
    fitted = []
    for drive in trial.drives:
        on = (drive.east >= begin) & (drive.east <= end)
        angle, along = frequency * drive.east[on] / speed, drive.east[on] - begin
        basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones_like(along), along])
        real, imaginary = np.linalg.lstsq(basis, drive.north[on], rcond=None)[0][:2]
        fitted.append(complex(real, imaginary))
    return tuple(fitted)
