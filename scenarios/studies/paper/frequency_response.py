"""Frequency response of the emulated convoy: the lead drives a sine, amplitudes are fitted.

The closed forms are in `vehicles.theory.propagation`: the paper's G(jω), in which a follower
steers by the difference of both cars' states at one instant, and F(jω), in which it steers
along the path that its predecessor left behind.
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
"""Frequencies (rad/s) of the sine, from a slow lane change to above what a car can follow."""

SHORT_FREQUENCIES = FREQUENCIES[2:]
"""Those driven with the short preview; lower ones take long and do not depend on it."""

PREVIEW_S = 0.8
SHORT_PREVIEW_S = 0.25
"""The paper's preview, and one with which the fit smooths little."""

MAX_AMPLITUDE = 0.5
"""Limit of the lead's amplitude (m)."""

MAX_ACCELERATION = 1.5
"""Limit of the lead's lateral acceleration (m/s²)."""

PERIODS = 3
"""Periods that are evaluated."""

TRANSIENT = 4.0
"""Least time (s), and at least one period, that is driven before the evaluation."""

SPACING = 0.5
"""Distance of the points of the lead's path (m)."""

STRAIGHT = 1.5
"""Time (s) driven straight before the sine begins."""

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
    """Drive a convoy behind a lead on a sine of `frequency` (rad/s); see `sine_scenario`."""
    scenario = sine_scenario(frequency, preview_s, trajectory)
    return SineResponse(frequency, preview_s, amplitudes(drive_trial(scenario), frequency))


def sine_scenario(
    frequency: float, preview_s: float = PREVIEW_S, trajectory: Trajectory = "fitted"
) -> Scenario:
    """The paper's base case (empty cars, no lead data) with a lead that drives a sine."""
    alone = (
        'control.fusion="predecessor"',
        f'control.trajectory="{trajectory}"',
        "loading.front_passengers=0",
        "loading.rear_passengers=0",
    )
    base = load_scenario("paper_base", (*alone, f"control.preview_s={preview_s}"))
    speed = base.tables.speed.set_mps
    convoy = sum(base.route.spacings)
    driven = STRAIGHT + RISE + max(TRANSIENT, 2.0 * pi / frequency)
    duration = ceil(driven + PERIODS * 2.0 * pi / frequency + convoy / speed) + 1.0
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
    """Fit a sine to each vehicle's path over the same stretch of road, by least squares (m).

    The stretch is the last PERIODS that all vehicles drove; a straight line is fitted as well.
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
