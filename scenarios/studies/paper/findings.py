"""What the runs of `convoy reproduce` found, before it is judged and drawn."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from scenarios.results.drives import Array, Trial
from scenarios.studies.paper.field_runs import FieldRuns
from scenarios.studies.paper.frequency_response import Weaving

SAME = 0.001
"""Largest errors that differ by less than this (m) count as equal."""


class Tally(NamedTuple):
    """In how many of several runs something holds."""

    holding: int
    runs: int


@dataclass
class Findings:
    """Results by their keys; what was not run is not in it."""

    trials: dict[str, Trial] = field(default_factory=dict)
    weavings: list[Weaving] = field(default_factory=list)
    field: FieldRuns | None = None
    gains_pictures: tuple[str, ...] | None = None

    def has(self, need: str) -> bool:
        """Whether the result called `need` is there."""
        match need:
            case "propagation":
                return bool(self.weavings)
            case "field":
                return self.field is not None
            case "gains":
                return self.gains_pictures is not None
        return need in self.trials

    def ratios(self, preview_s: float) -> tuple[Array, Array]:
        """Frequencies (rad/s, rising) of the swings with that preview; ratios (n, followers)."""
        found = [one for one in self.weavings if one.preview_s == preview_s]
        found.sort(key=lambda weaving: weaving.frequency)
        return (
            np.array([weaving.frequency for weaving in found]),
            np.array([weaving.ratios for weaving in found]),
        )

    def noisy(self, key: str) -> list[Trial]:
        """Runs with a receiver's noise, a seed each."""
        return [trial for name, trial in self.trials.items() if name.startswith(f"{key}/noise/")]

    def shifted(self, key: str) -> list[Trial]:
        """The exact run, and its repetitions with the road moved by less than between samples."""
        moved = [trial for name, trial in self.trials.items() if name.startswith(f"{key}/phase/")]
        return [self.trials[key], *moved]

    def seeds(self, holds: Callable[..., bool], *keys: str) -> Tally | None:
        """In how many noisy runs something holds of those of `keys`; None without such runs."""
        return _tally(holds, *map(self.noisy, keys))

    def phases(self, holds: Callable[..., bool], *keys: str) -> Tally | None:
        """In how many exact runs something holds of those of `keys`; None with but one each."""
        tally = _tally(holds, *map(self.shifted, keys))
        return tally if tally and tally.runs > 1 else None


def _tally(holds: Callable[..., bool], *runs: Sequence[Trial]) -> Tally | None:
    """In how many of the runs side by side something holds; None without any."""
    together = list(zip(*runs, strict=False))
    return Tally(sum(holds(*trials) for trials in together), len(together)) if together else None


def non_increasing(maxima: tuple[float, ...]) -> bool:
    """Whether no vehicle's largest error (m) exceeds that of the one ahead by SAME or more."""
    return all(behind < ahead + SAME for ahead, behind in pairwise(maxima))


def in_cm(maxima: tuple[float, ...]) -> str:
    """Largest errors (m) of the followers, front to back, as text in centimetres."""
    return ", ".join(f"{100.0 * value:.1f}" for value in maxima) + " cm"


def cm(value: float) -> str:
    """A length (m) as text in centimetres."""
    return f"{100.0 * value:z.1f} cm"
