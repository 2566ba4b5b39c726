"""Results of the runs of `convoy reproduce`, for claims, tables and plots."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from scenarios.results.drives import Array, Trial
from scenarios.studies.paper.fitted_samples import SampleFigures
from scenarios.studies.paper.frequency_response import SineResponse
from scenarios.studies.paper.keys import FIELD_WITH, Need, Part, RunKey, Variant
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.string_stability import is_string_stable

TOLERANCE_M = 0.001
"""Largest errors that differ by less (m) count as equal."""


ALTERNATIVES: dict[Variant, str] = {
    "slip_compensated": "slip compensation",
    "stanley": "Stanley's law",
    "pure_pursuit": "pure pursuit",
}
"""Steering laws that a row names if they do better than the paper's."""

LOST_M = 10.0
"""Errors (m) of cars that have lost their path; larger ones are not printed."""


class Tally(NamedTuple):
    """Number of runs in which a claim holds; `kind` names what differs between the runs."""

    holding: int
    runs: int
    kind: str = "phases"


@dataclass
class Findings:
    """Results with one kind of trajectory, by key.

    `samples` holds the logged runs only; `field_logs` holds the folder names of the logs of the
    field experiment.
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
        """Frequencies (rad/s, ascending) simulated with a preview, and ratios (n, followers)."""
        responses = [
            response for response in self.sine_responses if response.preview_s == preview_s
        ]
        responses.sort(key=lambda response: response.frequency)
        return (
            np.array([response.frequency for response in responses]),
            np.array([response.ratios for response in responses]),
        )

    def noisy(self, key: RunKey) -> list[Trial]:
        """Runs with receiver noise, one per seed."""
        return [
            trial
            for candidate, trial in self.trials.items()
            if candidate.seed is not None and candidate.exact == key
        ]

    def moved(self, key: RunKey) -> list[Trial]:
        """The exact run, and its repetitions on a road shifted by less than the sample distance."""
        repeated = [
            trial
            for candidate, trial in self.trials.items()
            if candidate.phase is not None and candidate.exact == key
        ]
        return [self.trials[key], *repeated]

    def seeds(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count the noisy runs of `keys` in which `holds` is true; None without such runs."""
        tally = _tally(holds, *map(self.noisy, keys))
        return tally and tally._replace(kind="seeds")

    def phases(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count the exact runs of `keys` in which `holds` is true; None for a single run."""
        tally = _tally(holds, *map(self.moved, keys))
        return tally if tally and tally.runs > 1 else None


def _tally(holds: Callable[..., bool], *runs: Sequence[Trial]) -> Tally | None:
    groups = list(zip(*runs, strict=False))
    return Tally(sum(holds(*trials) for trials in groups), len(groups)) if groups else None


def better_laws(findings: Findings, key: RunKey, measure: str = "tracking") -> str:
    """Name other steering laws whose largest errors in a case are smaller, with their errors.

    `measure` is `tracking` or `cross_track`, an attribute of a `Trial`.
    """
    own = max(getattr(findings.trials[key], measure))
    found = []
    for law, name in ALTERNATIVES.items():
        trial = findings.trials.get(key.with_variant(law))
        if trial is not None and max(getattr(trial, measure)) < own - TOLERANCE_M:
            found.append(f"{name} {in_cm(getattr(trial, measure))}")
    return f". Better: {'; '.join(found)}" if found else ""


def non_increasing(maxima: tuple[float, ...]) -> bool:
    """Whether no largest error (m) exceeds that of the car ahead by more than TOLERANCE_M."""
    return is_string_stable(maxima, TOLERANCE_M)


def in_cm(maxima: tuple[float, ...]) -> str:
    """Format the largest errors (m) of the followers, front to back."""
    texts = (f"{100.0 * m:.1f}" if m < LOST_M else f"over {100.0 * LOST_M:.0f}" for m in maxima)
    return ", ".join(texts) + " cm"


def cm(value: float) -> str:
    return f"{100.0 * value:z.1f} cm" if value < LOST_M else in_cm((value,))
