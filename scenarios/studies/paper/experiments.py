"""The runs of `convoy reproduce`, by case.

The paper's simulations use exact measurements and cars that know their own state. Additional runs
use a noisy receiver with several seeds, or change one setting. Every run is simulated with both
trajectories.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from enum import StrEnum
from math import acos, cos, sin
from typing import Literal

from vehicles.preview.curve_fit import Trajectory

# ---- Keys of the parts of a reproduction, and their text for folders, report.json and progress


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


# ---- Experiments


BASE_SEEDS = 3
"""Number of noisy runs of the base case, with and without the lead's data."""

OTHER_SEEDS = 2
"""Number of noisy runs of other cases, which end after the first lane change."""

FIRST_CHANGE_S = {BASE: 13.0, A: 31.0, B: 31.0, C: 17.0, D: 13.0, VARIABLE_SPEED: 15.0}
"""Time (s) at which the last car has completed the first lane change, by case."""

OWN_DURATION = (VARIABLE_SPEED, LONG_WITH, LONG_WITHOUT)
"""Cases whose runs on shifted roads last as long as the exact run.

At constant speed and without noise the second lane change mirrors the first one, so other cases
are repeated up to the end of the first.
"""

RADII = (200.0, 250.0, 300.0, 400.0, 500.0, 700.0, 1000.0)
"""Radii (m) of the curves; the paper states only hundreds of metres."""

ALPHAS = (0.0, 0.5, 0.75, 1.0)
"""Weights α of the predecessor in convoys of eight cars; 0.5 is the paper's."""

PREVIEWS_S = (0.4, 0.8, 1.0)
"""Previews (s); 0.8 is the paper's, and 1.0 s are the 30 m of Section III-A at 30 m/s."""

LOSSES_PERCENT = (30.0, 60.0)
"""Shares (%) of messages that each link loses."""

LATENCIES_MS = (100.0, 200.0, 400.0)
"""Latencies (ms) of the links; the other runs have 20 ms."""

NOISE_SEEDS = 2
"""Number of noisy runs of eight cars on a straight."""

BASE_SPEED = 30.0
"""Speed (m/s) of the base case and of the paper's theoretical figures."""

LANE = 3.6
"""Width of a lane (m)."""

EXACT = (
    "gnss.position_noise_m=0.0",
    "gnss.heading_noise_deg=0.0",
    "gnss.speed_noise_mps=0.0",
    "gnss.yaw_rate_noise_radps=0.0",
    'control.own_state="exact"',
)
"""Measurements without errors, and cars that know their own state, as in the paper's cases."""

NOISE = (
    'control.own_state="estimated"',
    "gnss.position_noise_m=0.02",
    "gnss.heading_noise_deg=0.1",
    "gnss.speed_noise_mps=0.03",
    "gnss.yaw_rate_noise_radps=0.00175",
    "imu.speed_noise_mps=0.03",
    "imu.speed_bias_mps=0.1",
    "imu.yaw_rate_noise_radps=0.00175",
    "imu.yaw_rate_bias_radps=0.00175",
)
"""An RTK receiver and an inertial sensor, from which a car estimates its own state."""

PHASES = (0.25, 0.5, 0.75)
"""Shifts of the road, as shares of `SAMPLING_S`, which show the effect of the sample positions."""

SAMPLING_S = 0.1
"""Common period (s) of poses (20 Hz) and decisions (50 Hz)."""

ROADS = {
    BASE: (30.0, (150.0, 600.0)),
    A: (10.0, (150.0, 600.0)),
    B: (10.0, (150.0, 600.0)),
    C: (20.0, (150.0, 600.0)),
    D: (30.0, (150.0, 600.0)),
    VARIABLE_SPEED: (20.0, (100.0, 525.0)),
}
"""Speed (m/s) at the first curve, and distances (m) at which lane changes begin, by case."""

FIELD_SEEDS = 2
"""Repetitions of the field experiment with noise."""

FIELD_DURATION = "duration_s=30.0"
"""Repetitions end in the first curve, after the lane change; exact runs end after one lap."""

FIELD_SPEED = 25.0
"""Speed (m/s) of the field experiment."""

PREDECESSOR_ONLY = ('information_flow.lateral="predecessor"',)
SLIP_COMPENSATED = ('control.controller="slip_compensated"',)
OWN_STATE_ESTIMATED = ('control.own_state="estimated"',)
"""Each car estimates its own state from its exact measurements."""
OTHER_LAWS: tuple[Literal["stanley", "pure_pursuit"], ...] = ("stanley", "pure_pursuit")
"""Steering laws compared with the paper's along the same trajectories."""

TRAJECTORY_KEY = "control.trajectory="
"""Prefix of the override that sets the trajectory of a run."""

MIN_STRAIGHT = 1.0
"""Shorter straights (m) are omitted."""

NO_INITIAL_ERROR = ("vehicle.PL2.lateral_offset_m=0.0", "vehicle.PL3.lateral_offset_m=0.0")
"""All cars of the field experiment start on the path."""

NO_SLOWING = ("speed.lateral_acceleration_mps2_max=5.0",)
"""Keeps the lead from slowing down in tight curves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    scenario: str = "paper_base"
    overrides: tuple[str, ...] = ()
    seed: int | None = None
    logged: bool = False

    @property
    def names_trajectory(self) -> bool:
        return any(override.startswith(TRAJECTORY_KEY) for override in self.overrides)

    def with_trajectory(self, trajectory: Trajectory) -> "Experiment":
        if self.names_trajectory:
            return self
        return replace(self, overrides=(f'{TRAJECTORY_KEY}"{trajectory}"', *self.overrides))


def lane_change_lengths(
    radius: float, speed: float = 30.0, width: float = LANE
) -> tuple[float, float]:
    """Length (m) of each arc of a lane change, and of the straight between them.

    An arc lasts a second, or less if two arcs of a second would exceed the lane width.
    """
    angle = speed / radius
    sideways = 2.0 * radius * (1.0 - cos(angle))
    if sideways >= width:
        return radius * acos(1.0 - 0.5 * width / radius), 0.0
    straight = (width - sideways) / sin(angle)
    return speed, straight if straight >= MIN_STRAIGHT else 0.0


def road(radius: float, arc: float, straight: float, begins: tuple[float, float]) -> str:
    """Override for a road with two lane changes, to the right and back, at two distances (m)."""

    def change(first: str, second: str) -> list[str]:
        between = [f"{{length_m={straight:.3f}}}"] if straight > 0.0 else []
        return [
            f'{{length_m={arc:.3f},radius_m={radius:.3f},turn="{first}"}}',
            *between,
            f'{{length_m={arc:.3f},radius_m={radius:.3f},turn="{second}"}}',
        ]

    gap = begins[1] - begins[0] - 2.0 * arc - straight
    parts = [
        f"{{length_m={begins[0]:.3f}}}",
        *change("right", "left"),
        f"{{length_m={gap:.3f}}}",
        *change("left", "right"),
        "{length_m=600.0}",
    ]
    return f"path.segments=[{','.join(parts)}]"


def at_the_same_times(speed: float) -> tuple[str, ...]:
    """Overrides for a road that takes as long at `speed` (m/s) as the base case's at 30 m/s.

    Every segment lasts a second. With radius 2 v² / 3.6 the lateral acceleration stays the same.
    """
    radius = 2.0 * speed**2 / LANE
    where = (5.0 * speed, 20.0 * speed)
    return (road(radius, speed, speed, where), "duration_s=15.0")


def _first_change(case: RunKey) -> tuple[str, ...]:
    return (f"duration_s={FIRST_CHANGE_S[case]}",)


def _noisy(key: RunKey, scenario: str, seeds: int, *changes: str) -> dict[RunKey, Experiment]:
    return {
        key.noisy(seed): Experiment(scenario=scenario, overrides=(*changes, *NOISE), seed=seed)
        for seed in range(1, seeds + 1)
    }


def _with_phases(key: RunKey, exact: Experiment, case: RunKey = BASE) -> dict[RunKey, Experiment]:
    """An exact run, and its repetitions on shifted roads."""
    speed, begins = ROADS[case]
    until = () if key in OWN_DURATION else _first_change(case)
    runs = {key: exact}
    for phase in PHASES:
        distance = phase * SAMPLING_S * speed
        place = road(500.0, 30.0, 30.0, (begins[0] + distance, begins[1] + distance))
        overrides = (*exact.overrides, place, *until)
        runs[key.moved(phase)] = replace(exact, overrides=overrides, logged=False)
    return runs


def _repeated(key: RunKey, seeds: int, *until: str) -> dict[RunKey, Experiment]:
    """One of the paper's cases: exact and logged, on shifted roads, and with noise."""
    name = f"paper_{key}"
    return {
        **_with_phases(key, Experiment(scenario=name, logged=True), key),
        **_noisy(key, name, seeds, *until),
    }


def _paper_case(key: RunKey) -> dict[RunKey, Experiment]:
    """One of the paper's other cases, with one trajectory per source, and with another law."""
    name, until = f"paper_{key}", _first_change(key)
    return {
        **_repeated(key, OTHER_SEEDS, *until),
        key.with_variant("blend"): Experiment(
            scenario=name, overrides=('control.fusion="blend"', *until)
        ),
        key.with_variant("slip_compensated"): Experiment(
            scenario=name, overrides=(*SLIP_COMPENSATED, *until)
        ),
    }


def _base_variant(*changes: str) -> Experiment:
    """The base case with changed settings, up to the end of the first lane change."""
    return Experiment(overrides=(*_first_change(BASE), *changes))


def _base() -> dict[RunKey, Experiment]:
    knows_loading = "control.knows_loading=true"
    return {
        **_repeated(BASE, BASE_SEEDS, *_first_change(BASE)),
        BASE.with_variant("as_is"): _base_variant(),
        BASE.with_variant("blend"): _base_variant('control.fusion="blend"'),
        BASE.with_variant("lead_only"): _base_variant("control.alpha_ratio=0.0"),
        BASE.with_variant("slip_compensated"): _base_variant(*SLIP_COMPENSATED),
        BASE.with_variant("slip_compensated_knows_loading"): _base_variant(
            *SLIP_COMPENSATED, knows_loading
        ),
        BASE.with_variant("knows_loading"): _base_variant(knows_loading),
        BASE.with_variant("gap_20_m"): _base_variant("convoy.gap_m=20.07"),
        BASE.with_variant("own_state_estimated"): _base_variant(*OWN_STATE_ESTIMATED),
        BASE.with_variant("paper_prefix"): _base_variant(f'{TRAJECTORY_KEY}"paper_prefix"'),
    }


def _laws() -> dict[RunKey, Experiment]:
    runs = _with_phases(BASE, Experiment(logged=True), BASE)
    for law in OTHER_LAWS:
        run = _base_variant(f'control.controller="{law}"')
        runs |= _with_phases(BASE.with_variant(law), run)
    return runs


def _a_or_c(key: RunKey, speed: float) -> dict[RunKey, Experiment]:
    again = Experiment(scenario=f"paper_{key}", overrides=at_the_same_times(speed))
    return {**_paper_case(key), key.with_variant("same_times"): again}


def at_alpha(alpha: float) -> RunKey:
    """Key of the run of eight cars with a weight α; α = 1 ignores the lead's data."""
    known = {0.5: LONG_WITH, 1.0: LONG_WITHOUT}
    return known.get(alpha, RunKey("alpha", value=alpha))


def at_preview(preview_s: float) -> RunKey:
    return BASE if preview_s == 0.8 else RunKey("preview", value=preview_s)


def _lead_data() -> dict[RunKey, Experiment]:
    eight_cars = ("convoy.vehicles=8", "duration_s=14.5")
    straight = ("path.segments=[{length_m=800.0}]", "convoy.vehicles=8", "duration_s=15.0")
    return {
        **_repeated(BASE, BASE_SEEDS, *_first_change(BASE)),
        **_with_phases(NO_LEAD_DATA, Experiment(overrides=PREDECESSOR_ONLY, logged=True)),
        **_noisy(NO_LEAD_DATA, "paper_base", BASE_SEEDS, *PREDECESSOR_ONLY, *_first_change(BASE)),
        **_with_phases(LONG_WITH, Experiment(overrides=eight_cars)),
        **_with_phases(LONG_WITHOUT, Experiment(overrides=(*eight_cars, *PREDECESSOR_ONLY))),
        RunKey("long", "slip_compensated"): Experiment(overrides=(*eight_cars, *SLIP_COMPENSATED)),
        **{
            at_alpha(alpha): Experiment(overrides=(*eight_cars, f"control.alpha_ratio={alpha}"))
            for alpha in ALPHAS
            if alpha not in {0.5, 1.0}
        },
        **_noisy(NOISE_WITH, "paper_base", NOISE_SEEDS, *straight),
        **_noisy(NOISE_WITHOUT, "paper_base", NOISE_SEEDS, *straight, *PREDECESSOR_ONLY),
    }


def _information() -> dict[RunKey, Experiment]:
    """The base case with other previews, and over links that lose or delay messages."""
    settings = {
        **{at_preview(t): f"control.preview_s={t}" for t in PREVIEWS_S if t != 0.8},
        **{
            RunKey("loss", value=percent): f"links.loss_ratio={percent / 100.0}"
            for percent in LOSSES_PERCENT
        },
        **{RunKey("latency", value=ms): f"links.latency_ms={ms}" for ms in LATENCIES_MS},
    }
    base = {BASE: Experiment(logged=True)}
    return base | {key: _base_variant(setting) for key, setting in settings.items()}


def _radius() -> dict[RunKey, Experiment]:
    runs = {}
    for radius in RADII:
        arc, straight = lane_change_lengths(radius)
        length = 2.0 * arc + straight
        until = f"duration_s={5.0 + length / 30.0 + 6.0:.1f}"
        changes = (*NO_SLOWING, road(radius, arc, straight, (150.0, 300.0 + length)), until)
        key = at_radius(radius)
        runs[key] = Experiment(overrides=changes)
        runs[key.with_variant("no_lead_data")] = Experiment(overrides=(*changes, *PREDECESSOR_ONLY))
        runs[key.with_variant("slip_compensated")] = Experiment(
            overrides=(*changes, *SLIP_COMPENSATED)
        )
        runs |= _noisy(key, "paper_base", 2, *changes)
    return runs


def _field() -> dict[RunKey, Experiment]:
    """Repetitions of the field experiment, on shifted roads and with noise, as live convoys.

    Followers treat a replay like a live car. `field_runs` simulates the exact runs, car by car. The
    runs without initial errors exist as live convoys only.
    """

    def live(*changes: str) -> Experiment:
        return Experiment(scenario="paper_field", overrides=(*EXACT, *changes, FIELD_DURATION))

    runs = {
        FIELD_NO_INITIAL_ERROR: live(*NO_INITIAL_ERROR),
        FIELD_SLIP_COMPENSATED: live(*NO_INITIAL_ERROR, *SLIP_COMPENSATED),
    }
    for key, changes in (
        (FIELD_WITH, ()),
        (FIELD_WITHOUT, PREDECESSOR_ONLY),
        (FIELD_NO_INITIAL_ERROR, NO_INITIAL_ERROR),
    ):
        for phase in PHASES:
            place = f"path.segments.0.length_m={100.0 + phase * SAMPLING_S * FIELD_SPEED}"
            runs[key.moved(phase)] = live(*changes, place)
    for key, changes in ((FIELD_WITH, ()), (FIELD_WITHOUT, PREDECESSOR_ONLY)):
        runs |= _noisy(key, "paper_field", FIELD_SEEDS, *changes, FIELD_DURATION)
    return runs


RUNS_OF_CASE: Mapping[str, Mapping[RunKey, Experiment]] = {
    "base": _base(),
    "a": _a_or_c(A, 10.0),
    "b": _paper_case(B),
    "c": _a_or_c(C, 20.0),
    "d": _paper_case(D),
    "variable_speed": _paper_case(VARIABLE_SPEED),
    "lead_data": _lead_data(),
    "information": _information(),
    "laws": _laws(),
    "radius": _radius(),
    Part.PROPAGATION: {},
    Part.GAINS: {},
    Part.FIELD: _field(),
}
"""The runs of each case; `propagation`, `gains` and `field` have jobs of their own."""
