"""How a sideways swing travels down the real convoy: the lead weaves, amplitudes are read off.

Beside it the closed forms of `vehicles.theory.string_stability`: the paper's G(jω), in which a
follower steers by the difference of both cars' states at one instant, and F(jω), in which it steers
along the path that its predecessor left behind.
"""

from dataclasses import dataclass
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path import PointsPath
from scenarios.results.drives import Trial
from scenarios.runs.rehearsal import rehearse

Array = NDArray[np.float64]

FREQUENCIES = (0.8, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Frequencies (rad/s) of the swing: from a lazy lane change to beyond what cars do."""

PREVIEW_S = 0.8
SHORT_PREVIEW_S = 0.25
"""The paper's preview, and one with which the fit smooths little away."""

SWING = 0.5
"""Largest amplitude of the lead's swing (m)..."""

SIDEWAYS = 1.5
"""...and its largest sideways acceleration (m/s²)."""

PERIODS = 3
"""Periods that are evaluated; as long as one, but at least SETTLING (s), goes before."""

SETTLING = 4.0
SPACING = 0.5
"""Distance of the points of the lead's path (m)."""

STRAIGHT = 1.5
"""Time (s) driven straight before the swing grows to its amplitude over RISE (s)."""

RISE = 2.0


@dataclass(frozen=True)
class Weaving:
    """Complex amplitude (m) of each vehicle's path at one frequency (rad/s), the lead first."""

    frequency: float
    preview_s: float
    amplitudes: tuple[complex, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        """Amplitude of each follower over that of the vehicle ahead of it."""
        sizes = np.abs(self.amplitudes)
        return tuple((sizes[1:] / sizes[:-1]).tolist())


def weave(frequency: float, preview_s: float = PREVIEW_S) -> Weaving:
    """Drive a convoy behind a lead that weaves at `frequency` (rad/s); see `weaving_scenario`."""
    scenario = weaving_scenario(frequency, preview_s)
    return Weaving(frequency, preview_s, amplitudes(rehearse(scenario), frequency))


def weaving_scenario(frequency: float, preview_s: float = PREVIEW_S) -> Scenario:
    """Make the paper's base case (empty cars, no lead data) with a lead that weaves."""
    alone = (
        'control.fusion="predecessor"',
        "loading.front_passengers=0",
        "loading.rear_passengers=0",
    )
    base = load_scenario("paper_base", (*alone, f"control.preview_s={preview_s}"))
    speed = base.tables.speed.set_mps
    gaps = sum(base.route.gaps)
    driven = STRAIGHT + RISE + max(SETTLING, 2.0 * pi / frequency)
    duration = ceil(driven + PERIODS * 2.0 * pi / frequency + gaps / speed) + 1.0
    east = np.arange(0.0, speed * duration + 60.0, SPACING)
    since = east / speed - STRAIGHT
    rise = np.clip(since / RISE, 0.0, 1.0)
    height = min(SWING, SIDEWAYS / frequency**2) * rise * rise * (3.0 - 2.0 * rise)
    path = PointsPath(
        kind="points",
        source="weaving",
        east_m=tuple(east.tolist()),
        north_m=tuple((height * np.sin(frequency * since)).tolist()),
        smoothing_m=2.0,
    )
    return Scenario(base.tables.model_copy(update={"path": path, "duration_s": duration}))


def amplitudes(trial: Trial, frequency: float) -> tuple[complex, ...]:
    """Fit a sine over the same stretch of road to each vehicle's path, by least squares (m).

    The stretch is the last PERIODS that all have driven; a straight line is fitted beside it.
    """
    speed = float(trial.lead.speed.mean())
    end = min(float(drive.east[-1]) for drive in trial.drives)
    begin = end - PERIODS * 2.0 * pi * speed / frequency
    found = []
    for drive in trial.drives:
        on = (drive.east >= begin) & (drive.east <= end)
        angle, along = frequency * drive.east[on] / speed, drive.east[on] - begin
        basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones_like(along), along])
        real, imaginary = np.linalg.lstsq(basis, drive.north[on], rcond=None)[0][:2]
        found.append(complex(real, imaginary))
    return tuple(found)
