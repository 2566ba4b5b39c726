"""The runs of `convoy paper reproduce`, by case.

The paper's simulations use exact measurements and cars that know their own state. Additional runs
use a noisy receiver with several seeds, or change one setting. Every run is simulated with both
trajectories. A run has a text as its key, such as "base", "radius/300/no_lead_data",
"base/phase/0.25" (on a shifted road) or "base/noise/1" (with receiver noise). Runs "long" have
eight cars with and without the lead's data, and "noise_along" eight noisy cars on a straight.
"""

from collections.abc import Iterable, Mapping
from math import acos, ceil, cos, pi, sin
from typing import NamedTuple

import numpy as np

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from vehicles.preview.curve_fit import Trajectory

Runs = dict[str, "PaperRun"]

# ---- Keys


TRAJECTORIES: dict[Trajectory, str] = {
    "fitted": "fitted trajectory",
    "paper": "the paper's trajectory",
}
"""The default fit, and the paper's recipe taken literally; with their names in the report."""

SIMULATIONS = ("base", "a", "b", "c", "d", "variable_speed")
"""The paper's simulations (Section V-C)."""
RADII = (200.0, 250.0, 300.0, 400.0, 500.0, 700.0, 1000.0)
"""Radii (m) of the curves; the paper states only hundreds of metres."""
ALPHAS = (0.0, 0.5, 0.75, 1.0)
"""Weights α of the predecessor in convoys of eight cars; 0.5 is the paper's."""
PREVIEWS_S = (0.4, 0.8, 1.0)
"""Previews (s); 0.8 is the paper's, and 1.0 s are the 30 m of Section III-A at 30 m/s."""
LOSSES_PERCENT = (30.0, 60.0)
LATENCIES_MS = (100.0, 200.0, 400.0)
"""Messages that each link loses (%), or its latency (ms); other runs have 20 ms and no loss."""
PREVIEW_S, SHORT_PREVIEW_S = 0.8, 0.25
"""Previews (s) behind a lead on a sine: the paper's, and one that smooths little."""
FREQUENCIES = (0.8, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Frequencies (rad/s) of the sine, from a slow lane change to beyond a car's bandwidth."""
SINES = {PREVIEW_S: FREQUENCIES, SHORT_PREVIEW_S: FREQUENCIES[2:]}
"""Lower frequencies do not depend on the preview."""
OTHER_LAWS = ("stanley", "pure_pursuit")
"""Steering laws compared with the paper's along the same trajectories."""


def at_radius(radius: float) -> str:
    return f"radius/{radius:g}"


def at_alpha(alpha: float) -> str:
    return {0.5: "long/with", 1.0: "long/without"}.get(alpha, f"alpha/{alpha:g}")


def at_preview(preview_s: float) -> str:
    return "base" if preview_s == PREVIEW_S else f"preview/{preview_s:g}"


def at_sine(preview_s: float, frequency: float) -> str:
    return f"sine/{preview_s:g}_s/{frequency:g}_radps"


def label(key: str) -> str:
    return key.upper() if len(key) == 1 else key.replace("_", " ")


# ---- Runs


BASE_SPEED = 30.0
"""Speed (m/s) of the base case and of the paper's theoretical figures."""
FIELD_SPEED = 25.0
LANE = 3.6
"""Width of a lane (m)."""
MIN_STRAIGHT = 1.0
"""Shorter straights (m) are omitted."""
PHASES = (0.25, 0.5, 0.75)
"""Shifts of the road, as shares of `SAMPLING_S`, which show the effect of the sample positions."""
SAMPLING_S = 0.1
"""Common period (s) of poses (20 Hz) and decisions (50 Hz)."""

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

PREDECESSOR_ONLY = 'information_flow.lateral="predecessor"'
SLIP_COMPENSATED = 'control.controller="slip_compensated"'
KNOWS_LOADING = "control.knows_loading=true"
BLEND = 'control.fusion="blend"'
NO_INITIAL_ERROR = ("vehicle.PL2.lateral_offset_m=0.0", "vehicle.PL3.lateral_offset_m=0.0")
EIGHT_CARS = ("convoy.vehicles=8", "duration_s=14.5")
STRAIGHT = ("path.segments=[{length_m=800.0}]", "convoy.vehicles=8", "duration_s=15.0")

FIRST_CHANGE = {
    key: f"duration_s={seconds}"
    for key, seconds in zip(SIMULATIONS, (13.0, 31.0, 31.0, 17.0, 13.0, 15.0), strict=True)
}
"""Runs that end when the last car has completed the first lane change.

At constant speed and without noise the second lane change mirrors the first one.
"""
ROADS = {
    **dict.fromkeys(("base", "d"), (30.0, 150.0, 600.0)),
    **dict.fromkeys(("a", "b"), (10.0, 150.0, 600.0)),
    "c": (20.0, 150.0, 600.0),
    "variable_speed": (20.0, 100.0, 525.0),
}
"""Speed (m/s) at the first curve, and distances (m) at which lane changes begin, by case."""


class PaperRun(NamedTuple):
    """Scenario, overrides, seed of noise, frequency (rad/s) of the lead's sine, if there is one."""

    overrides: tuple[str, ...] = ()
    scenario: str = "paper_base"
    seed: int | None = None
    logged: bool = False
    sine: float | None = None

    def with_trajectory(self, trajectory: Trajectory) -> Scenario:
        """Load the scenario; an override that sets another trajectory prevails."""
        overrides = (f'control.trajectory="{trajectory}"', *self.overrides)
        loaded = load_scenario(self.scenario, overrides, self.seed)
        return loaded if self.sine is None else on_a_sine(loaded, self.sine)


def lane_change_lengths(
    radius: float, speed: float = BASE_SPEED, width: float = LANE
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


def road(radius: float, arc: float, straight: float, first: float, second: float) -> str:
    """Override for a road with two lane changes, to the right and back, at two distances (m)."""

    def change(*turns: str) -> list[str]:
        arcs = [f'{{length_m={arc:.3f},radius_m={radius:.3f},turn="{turn}"}}' for turn in turns]
        return [arcs[0], *([f"{{length_m={straight:.3f}}}"] if straight > 0.0 else []), arcs[1]]

    gap = second - first - 2.0 * arc - straight
    parts = (
        f"{{length_m={first:.3f}}}",
        *change("right", "left"),
        f"{{length_m={gap:.3f}}}",
        *change("left", "right"),
        "{length_m=600.0}",
    )
    return f"path.segments=[{','.join(parts)}]"


def _at_the_same_times(key: str) -> PaperRun:
    """A road that takes as long as the base case's, with the same lateral acceleration."""
    speed = ROADS[key][0]
    where = road(2.0 * speed**2 / LANE, speed, speed, 5.0 * speed, 20.0 * speed)
    return PaperRun((where, "duration_s=15.0"), f"paper_{key}")


def _noisy(key: str, run: PaperRun, seeds: int) -> Runs:
    overrides = (*run.overrides, *NOISE)
    return {
        f"{key}/noise/{seed}": run._replace(overrides=overrides, seed=seed, logged=False)
        for seed in range(1, seeds + 1)
    }


def _with_phases(key: str, exact: PaperRun, *until: str, case: str = "base") -> Runs:
    """An exact run, and its repetitions on shifted roads, which may end earlier."""
    speed, first, second = ROADS[case]
    runs = {key: exact}
    for phase in PHASES:
        shift = phase * SAMPLING_S * speed
        place = road(500.0, 30.0, 30.0, first + shift, second + shift)
        overrides = (*exact.overrides, place, *until)
        runs[f"{key}/phase/{phase:g}"] = exact._replace(overrides=overrides, logged=False)
    return runs


def _repeated(key: str, seeds: int) -> Runs:
    """One of the paper's cases: exact and logged, on shifted roads, and with noise."""
    run, first = PaperRun(scenario=f"paper_{key}", logged=True), FIRST_CHANGE[key]
    until = () if key == "variable_speed" else (first,)
    shifted = _with_phases(key, run, *until, case=key)
    return shifted | _noisy(key, run._replace(overrides=(first,)), seeds)


def _paper_case(key: str) -> Runs:
    """One of the paper's other cases, with one trajectory per source, and with another law."""
    name, first = f"paper_{key}", FIRST_CHANGE[key]
    return {
        **_repeated(key, 2),
        f"{key}/blend": PaperRun((BLEND, first), name),
        f"{key}/slip_compensated": PaperRun((SLIP_COMPENSATED, first), name),
    }


def _base_variants(settings: Mapping[str, Iterable[str]]) -> Runs:
    """The base case with changed settings, up to the end of the first lane change."""
    return {key: PaperRun((FIRST_CHANGE["base"], *changes)) for key, changes in settings.items()}


BASE_VARIANTS = {
    "as_is": (),
    "blend": (BLEND,),
    "lead_only": ("control.alpha_ratio=0.0",),
    "slip_compensated": (SLIP_COMPENSATED,),
    "slip_compensated_knows_loading": (SLIP_COMPENSATED, KNOWS_LOADING),
    "knows_loading": (KNOWS_LOADING,),
    "gap_20_m": ("convoy.gap_m=20.07",),
    "own_state_estimated": ('control.own_state="estimated"',),
    "paper_prefix": ('control.trajectory="paper_prefix"',),
}


def _laws() -> Runs:
    runs = _with_phases("base", PaperRun(logged=True), FIRST_CHANGE["base"])
    for law in OTHER_LAWS:
        run = PaperRun((FIRST_CHANGE["base"], f'control.controller="{law}"'))
        runs |= _with_phases(f"base/{law}", run, FIRST_CHANGE["base"])
    return runs


def _lead_data() -> Runs:
    first, alone = FIRST_CHANGE["base"], PaperRun((PREDECESSOR_ONLY,))
    return {
        **_repeated("base", 3),
        **_with_phases("no_lead_data", alone._replace(logged=True), first),
        **_noisy("no_lead_data", PaperRun((PREDECESSOR_ONLY, first)), 3),
        **_with_phases("long/with", PaperRun(EIGHT_CARS)),
        **_with_phases("long/without", PaperRun((*EIGHT_CARS, PREDECESSOR_ONLY))),
        "long/slip_compensated": PaperRun((*EIGHT_CARS, SLIP_COMPENSATED)),
        **{
            at_alpha(alpha): PaperRun((*EIGHT_CARS, f"control.alpha_ratio={alpha}"))
            for alpha in ALPHAS
            if alpha not in {0.5, 1.0}
        },
        **_noisy("noise_along/with", PaperRun(STRAIGHT), 2),
        **_noisy("noise_along/without", PaperRun((*STRAIGHT, PREDECESSOR_ONLY)), 2),
    }


def _information() -> Runs:
    """The base case with other previews, and over links that lose or delay messages."""
    settings = {
        **{at_preview(t): (f"control.preview_s={t}",) for t in PREVIEWS_S if t != PREVIEW_S},
        **{f"loss/{loss:g}": (f"links.loss_ratio={loss / 100.0}",) for loss in LOSSES_PERCENT},
        **{f"latency/{ms:g}": (f"links.latency_ms={ms}",) for ms in LATENCIES_MS},
    }
    return {"base": PaperRun(logged=True)} | _base_variants(settings)


def _radius() -> Runs:
    runs: Runs = {}
    for radius in RADII:
        arc, straight = lane_change_lengths(radius)
        length = 2.0 * arc + straight
        run = PaperRun(
            (
                "speed.lateral_acceleration_mps2_max=5.0",  # the lead does not slow down
                road(radius, arc, straight, 150.0, 300.0 + length),
                f"duration_s={5.0 + length / BASE_SPEED + 6.0:.1f}",
            )
        )
        key = at_radius(radius)
        runs[key] = run
        for name, change in (
            ("no_lead_data", PREDECESSOR_ONLY),
            ("slip_compensated", SLIP_COMPENSATED),
        ):
            runs[f"{key}/{name}"] = run._replace(overrides=(*run.overrides, change))
        runs |= _noisy(key, run, 2)
    return runs


def _field() -> Runs:
    """The field experiment: exact and logged over one lap, and repeated.

    Repetitions end in the first curve. The authors drove one car behind records of its earlier
    runs; followers treat a record like a live car, so all cars drive at once here.
    """
    runs: Runs = {}
    for key, changes, phases in (
        ("field/with", (), PHASES),
        ("field/without", (PREDECESSOR_ONLY,), PHASES),
        ("field/no_initial_error", NO_INITIAL_ERROR, PHASES),
        ("field/slip_compensated", (*NO_INITIAL_ERROR, SLIP_COMPENSATED), ()),
    ):
        run = PaperRun((*EXACT, *changes, "duration_s=30.0"), "paper_field")
        runs[key] = run
        for phase in phases:
            place = f"path.segments.0.length_m={100.0 + phase * SAMPLING_S * FIELD_SPEED}"
            runs[f"{key}/phase/{phase:g}"] = run._replace(overrides=(*run.overrides, place))
        if key in {"field/with", "field/without"}:
            runs[key] = PaperRun((*EXACT, *changes), "paper_field", logged=True)
            runs |= _noisy(key, PaperRun((*changes, "duration_s=30.0"), "paper_field"), 2)
    return runs


def _sines() -> Runs:
    """The base case with empty cars, no lead data, and a lead that drives a sine."""
    empty = ("loading.front_passengers=0", "loading.rear_passengers=0")
    return {
        at_sine(preview, frequency): PaperRun(
            (PREDECESSOR_ONLY, *empty, f"control.preview_s={preview}"), sine=frequency
        )
        for preview, frequencies in SINES.items()
        for frequency in frequencies
    }


RUNS_OF_CASE: dict[str, Runs] = {
    "base": _repeated("base", 3)
    | _base_variants({f"base/{name}": changes for name, changes in BASE_VARIANTS.items()}),
    "a": _paper_case("a") | {"a/same_times": _at_the_same_times("a")},
    "b": _paper_case("b"),
    "c": _paper_case("c") | {"c/same_times": _at_the_same_times("c")},
    "d": _paper_case("d"),
    "variable_speed": _paper_case("variable_speed"),
    "lead_data": _lead_data(),
    "information": _information(),
    "laws": _laws(),
    "radius": _radius(),
    "propagation": _sines(),
    "gains": {},
    "field": _field(),
}
"""The runs of each case; `gains` is the report of `convoy paper gains`."""


# ---- A lead that drives a sine


MAX_AMPLITUDE, MAX_ACCELERATION = 0.5, 1.5
"""Limits of the lead's amplitude (m) and of its lateral acceleration (m/s²)."""
PERIODS = 3
"""Number of evaluated periods."""
LEAD_IN_S, RISE_S, TRANSIENT_S = 1.5, 2.0, 4.0
"""Times (s) on a straight, until the sine has its amplitude, and at least until the evaluation."""
SPACING = 0.5
"""Distance (m) between the points of a path."""


def on_a_sine(base: Scenario, frequency: float) -> Scenario:
    """Let the lead of a scenario drive a sine of `frequency` (rad/s)."""
    speed = base.tables.speed.set_mps
    convoy, period = sum(base.route.spacings), 2.0 * pi / frequency
    transient = LEAD_IN_S + RISE_S + max(TRANSIENT_S, period)
    duration = ceil(transient + PERIODS * period + convoy / speed) + 1.0
    east = np.arange(0.0, speed * duration + 60.0, SPACING)
    since = east / speed - LEAD_IN_S
    rise = np.clip(since / RISE_S, 0.0, 1.0)
    height = min(MAX_AMPLITUDE, MAX_ACCELERATION / frequency**2) * rise * rise * (3.0 - 2.0 * rise)
    path = PointsPath(
        kind="points",
        source="sine",
        east_m=tuple(east.tolist()),
        north_m=tuple((height * np.sin(frequency * since)).tolist()),
        smoothing_m=2.0,
    )
    return Scenario(base.tables.model_copy(update={"path": path, "duration_s": duration}))
