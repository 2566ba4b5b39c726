"""Keys of the parts of a reproduction, and their text for folders, report.json and progress."""

from dataclasses import KW_ONLY, dataclass, replace
from enum import StrEnum
from typing import Literal

from vehicles.preview.curve_fit import Trajectory

TRAJECTORIES: tuple[Trajectory, ...] = ("fitted", "paper")
"""Every run uses both: the default fit, and the paper's recipe taken literally."""

TRAJECTORY_NAMES: dict[Trajectory, str] = {
    "fitted": "fitted trajectory",
    "paper": "the paper's trajectory",
}
"""Names in the report."""

Setup = Literal[
    "base",
    "a",
    "b",
    "c",
    "d",
    "variable_speed",
    "no_lead_data",
    "long",
    "radius",
    "alpha",
    "preview",
    "loss",
    "latency",
    "noise_along",
    "field",
]
"""Convoy and road: a case of the paper, or an additional one that tests a claim."""

Variant = Literal[
    "as_is",
    "blend",
    "gap_20_m",
    "knows_loading",
    "lead_only",
    "no_initial_error",
    "no_lead_data",
    "own_state_estimated",
    "paper_prefix",
    "pure_pursuit",
    "same_times",
    "slip_compensated",
    "slip_compensated_knows_loading",
    "stanley",
    "with",
    "without",
]
"""The changed setting."""


@dataclass(frozen=True, slots=True)
class RunKey:
    """One run: setup, changed setting, value of a varied quantity, and repetition.

    `value` is a radius (m) of the curves, α, a preview (s), a loss (%) or a latency (ms).
    `phase` is the shift of the road as a share of the sample distance, `seed` that of the
    receiver's noise. A run with neither is the exact run.
    """

    setup: Setup
    variant: Variant | None = None
    _: KW_ONLY
    value: float | None = None
    phase: float | None = None
    seed: int | None = None

    def __str__(self) -> str:
        parts: list[str] = [self.setup]
        if self.value is not None:
            parts.append(f"{self.value:g}")
        if self.variant is not None:
            parts.append(self.variant)
        if self.phase is not None:
            parts.append(f"phase/{self.phase:g}")
        if self.seed is not None:
            parts.append(f"noise/{self.seed}")
        return "/".join(parts)

    @property
    def label(self) -> str:
        text = str(self)
        return text.upper() if len(text) == 1 else text.replace("_", " ")

    @property
    def exact(self) -> "RunKey":
        return replace(self, phase=None, seed=None)

    def with_variant(self, variant: Variant) -> "RunKey":
        return replace(self, variant=variant)

    def moved(self, phase: float) -> "RunKey":
        return replace(self, phase=phase)

    def noisy(self, seed: int) -> "RunKey":
        return replace(self, seed=seed)


BASE = RunKey("base")
A, B, C, D = RunKey("a"), RunKey("b"), RunKey("c"), RunKey("d")
VARIABLE_SPEED = RunKey("variable_speed")
NO_LEAD_DATA = RunKey("no_lead_data")
LONG_WITH, LONG_WITHOUT = RunKey("long", "with"), RunKey("long", "without")
"""Eight cars with and without the lead's data."""

NOISE_WITH, NOISE_WITHOUT = RunKey("noise_along", "with"), RunKey("noise_along", "without")
"""Eight cars with receiver noise on a straight; there is no exact run."""

FIELD_WITH, FIELD_WITHOUT = RunKey("field", "with"), RunKey("field", "without")
FIELD_NO_INITIAL_ERROR = RunKey("field", "no_initial_error")
FIELD_SLIP_COMPENSATED = RunKey("field", "slip_compensated")
"""The field experiment with lead data and without initial errors, by the steering law."""


def at_radius(radius: float) -> RunKey:
    return RunKey("radius", value=radius)


class Part(StrEnum):
    """A part of the reproduction that consists of several runs."""

    PROPAGATION = "propagation"
    GAINS = "gains"
    FIELD = "field"


@dataclass(frozen=True, slots=True)
class SineKey:
    """Run behind a lead that drives a sine: frequency (rad/s) and preview of the followers (s)."""

    frequency: float
    preview_s: float

    def __str__(self) -> str:
        return f"{Part.PROPAGATION} at {self.frequency:g} rad/s, preview {self.preview_s:g} s"


Need = RunKey | Part
"""A result that a claim or a picture needs."""


@dataclass(frozen=True, slots=True)
class WithTrajectory:
    """A part of the reproduction with one kind of trajectory."""

    trajectory: Trajectory
    part: RunKey | SineKey | Literal[Part.FIELD]

    def __str__(self) -> str:
        return f"{self.trajectory}/{self.part}"


JobKey = WithTrajectory | RunKey | Literal[Part.GAINS]
"""A part that runs as one job; a run whose overrides set the trajectory is a bare `RunKey`."""
