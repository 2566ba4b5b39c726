"""Results of the runs of `convoy reproduce`, before they are judged and drawn."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scenarios.results.drives import Array, Trial
from scenarios.studies.paper.fitted_samples import SampleFigures
from scenarios.studies.paper.frequency_response import SineResponse
from scenarios.studies.paper.keys import FIELD_WITH, Need, Part, RunKey
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.string_stability import is_string_stable

TOLERANCE_M = 0.001
"""Largest errors that differ by less than this (m) count as equal."""


class Tally(NamedTuple):
    """Count of the runs in which a statement holds, and what distinguishes these runs."""

    holding: int
    runs: int
    kind: str = "phases"


@dataclass
class Findings:
    """Results along one kind of trajectory, by key.

    `trials` and `samples` lack what was not run; `samples` are those of the logged runs, and
    `field_logs` the folder names of the field experiment's logs.
    """

    trajectory: Trajectory = "fitted"
    trials: dict[RunKey, Trial] = field(default_factory=dict)
    samples: dict[RunKey, SampleFigures] = field(default_factory=dict)
    sine_responses: list[SineResponse] = field(default_factory=list)
    field_logs: tuple[str, ...] = ()
    gains_pictures: tuple[str, ...] | None = None

    def has(self, need: Need) -> bool:
        match need:
            case RunKey():
                return need in self.trials
            case Part.PROPAGATION:
                return bool(self.sine_responses)
            case Part.FIELD:
                return FIELD_WITH in self.trials
            case Part.GAINS:
                return self.gains_pictures is not None

    def ratios(self, preview_s: float) -> tuple[Array, Array]:
        """Frequencies (rad/s, rising) driven with that preview, and ratios (n, followers)."""
        responses = [
            response for response in self.sine_responses if response.preview_s == preview_s
        ]
        responses.sort(key=lambda response: response.frequency)
        return (
            np.array([response.frequency for response in responses]),
            np.array([response.ratios for response in responses]),
        )

    def noisy(self, key: RunKey) -> list[Trial]:
        """Runs with a receiver's noise, one per seed."""
        return [
            trial
            for candidate, trial in self.trials.items()
            if candidate.seed is not None and candidate.exact == key
        ]

    def moved(self, key: RunKey) -> list[Trial]:
        """The exact run, and its repetitions on a road moved by less than the sample distance."""
        repeated = [
            trial
            for candidate, trial in self.trials.items()
            if candidate.phase is not None and candidate.exact == key
        ]
        return [self.trials[key], *repeated]

    def seeds(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count of the noisy runs of `keys` in which `holds` is true; None without such runs."""
        tally = _tally(holds, *map(self.noisy, keys))
        return tally and tally._replace(kind="seeds")

    def phases(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count of the exact runs of `keys` in which `holds` is true; None for a single run."""
        tally = _tally(holds, *map(self.moved, keys))
        return tally if tally and tally.runs > 1 else None


def _tally(holds: Callable[..., bool], *runs: Sequence[Trial]) -> Tally | None:
    together = list(zip(*runs, strict=False))
    return Tally(sum(holds(*trials) for trials in together), len(together)) if together else None


def non_increasing(maxima: tuple[float, ...]) -> bool:
    """Whether no vehicle's largest error (m) exceeds that of the one ahead by more than SAME."""
    return is_string_stable(maxima, TOLERANCE_M)


def in_cm(maxima: tuple[float, ...]) -> str:
    """Largest errors (m) of the followers, front to back, as text."""
    return ", ".join(f"{100.0 * value:.1f}" for value in maxima) + " cm"


def cm(value: float) -> str:
    return f"{100.0 * value:z.1f} cm"
