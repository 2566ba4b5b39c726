"""What the runs of `convoy reproduce` found, before it is judged and drawn."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scenarios.results.drives import Array, Trial
from scenarios.studies.paper.field_runs import FieldRuns
from scenarios.studies.paper.fitted_samples import SampleFigures
from scenarios.studies.paper.frequency_response import SineResponse
from scenarios.studies.paper.keys import Need, Part, RunKey
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.string_stability import is_string_stable

SAME = 0.001
"""Largest errors that differ by less than this (m) count as equal."""


class Tally(NamedTuple):
    """In how many of several runs something holds, and what tells these runs apart."""

    holding: int
    runs: int
    kind: str = "phases"


@dataclass
class Findings:
    """Results along one kind of trajectory by their keys; what was not run is not in it.

    `samples` are those of the logged runs.
    """

    trajectory: Trajectory = "fitted"
    trials: dict[RunKey, Trial] = field(default_factory=dict)
    samples: dict[RunKey, SampleFigures] = field(default_factory=dict)
    sine_responses: list[SineResponse] = field(default_factory=list)
    field: FieldRuns | None = None
    gains_pictures: tuple[str, ...] | None = None

    def has(self, need: Need) -> bool:
        """Whether the result was found."""
        match need:
            case RunKey():
                return need in self.trials
            case Part.PROPAGATION:
                return bool(self.sine_responses)
            case Part.FIELD:
                return self.field is not None
            case Part.GAINS:
                return self.gains_pictures is not None

    def ratios(self, preview_s: float) -> tuple[Array, Array]:
        """Frequencies (rad/s, rising) driven with that preview, and ratios (n, followers)."""
        found = [one for one in self.sine_responses if one.preview_s == preview_s]
        found.sort(key=lambda response: response.frequency)
        return (
            np.array([response.frequency for response in found]),
            np.array([response.ratios for response in found]),
        )

    def noisy(self, key: RunKey) -> list[Trial]:
        """Runs with a receiver's noise, a seed each."""
        return [
            trial for one, trial in self.trials.items() if one.seed is not None and one.exact == key
        ]

    def moved(self, key: RunKey) -> list[Trial]:
        """The exact run, and its repetitions with the road moved by less than between samples."""
        repeated = [
            trial
            for one, trial in self.trials.items()
            if one.phase is not None and one.exact == key
        ]
        return [self.trials[key], *repeated]

    def seeds(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """In how many noisy runs something holds of those of `keys`; None without such runs."""
        tally = _tally(holds, *map(self.noisy, keys))
        return tally and tally._replace(kind="seeds")

    def phases(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """In how many exact runs something holds of those of `keys`; None with but one each."""
        tally = _tally(holds, *map(self.moved, keys))
        return tally if tally and tally.runs > 1 else None


def _tally(holds: Callable[..., bool], *runs: Sequence[Trial]) -> Tally | None:
    """In how many of the runs side by side something holds; None without any."""
    together = list(zip(*runs, strict=False))
    return Tally(sum(holds(*trials) for trials in together), len(together)) if together else None


def non_increasing(maxima: tuple[float, ...]) -> bool:
    """Whether no vehicle's largest error (m) exceeds that of the one ahead by more than SAME."""
    return is_string_stable(maxima, SAME)


def in_cm(maxima: tuple[float, ...]) -> str:
    """Largest errors (m) of the followers, front to back, as text in centimetres."""
    return ", ".join(f"{100.0 * value:.1f}" for value in maxima) + " cm"


def cm(value: float) -> str:
    """A length (m) as text in centimetres."""
    return f"{100.0 * value:z.1f} cm"
