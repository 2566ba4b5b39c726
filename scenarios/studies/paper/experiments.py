"""The runs of `convoy reproduce`, by case: which scenario with what changed, and what is logged.

The paper's simulations are done with exact measurements; beside them stand runs with the noise of
a real receiver, over several seeds, and runs that change one thing to find out what it does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import acos, cos, sin

EXACT_SEEDS = 5
"""Noisy runs of the base case, with and without the lead's data."""

OTHER_SEEDS = 3
"""Noisy runs of every other case, up to the end of its first lane change."""

FIRST_CHANGE_S = {"a": 31.0, "b": 31.0, "c": 17.0, "d": 15.0, "variable_speed": 15.0}
"""When (s) the last car is through the first lane change, at the speed of each case."""

RADII = (200.0, 250.0, 300.0, 400.0, 500.0, 700.0, 1000.0)
"""Radii (m) of the bends, of which the paper says only that they are hundreds of metres."""

LANE = 3.6
"""Width of a lane (m)."""

NOISE = (
    "gnss.position_noise_m=0.02",
    "gnss.heading_noise_deg=0.1",
    "gnss.speed_noise_mps=0.03",
    "gnss.yaw_rate_noise_radps=0.00175",
)
"""An RTK receiver with an inertial unit, as in the other scenarios."""

PHASES = (0.25, 0.5, 0.75)
"""Shares of `SAMPLING_S` by which the road is moved, to see what hangs on where samples fall."""

SAMPLING_S = 0.1
"""After so long (s) the pattern of poses (20 Hz) and decisions (50 Hz) repeats."""

ROADS = {
    "base": (30.0, (150.0, 600.0)),
    "a": (10.0, (150.0, 600.0)),
    "b": (10.0, (150.0, 600.0)),
    "c": (20.0, (150.0, 600.0)),
    "d": (30.0, (150.0, 600.0)),
    "variable_speed": (20.0, (100.0, 525.0)),
}
"""Of each case's scenario the speed (m/s) at the first bend, and where lane changes begin (m)."""

FIELD_SEEDS = 2
"""Repetitions of the field experiment with other noise."""

FIRST_CHANGE = ("duration_s=15.0",)
"""The first of the two lane changes only."""

NO_LEAD_DATA = ('control.fusion="predecessor"',)
SLIP_COMPENSATED = ('control.controller="slip_compensated"',)
OWN_STATE_AT_50_HZ = ("gnss.rate_hz=50.0", "links.rate_hz=20.0")
"""Each car knows its own state at every decision; the others still hear it at 20 Hz."""

SHORTEST = 1.0
"""A straight shorter than this (m) is left out."""

SWERVE = ("speed.lateral_acceleration_mps2_max=5.0",)
"""Lets the lead take the tightest bends at full speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """One run: a scenario that ships, what is laid over it, its seed, and whether it is logged."""

    scenario: str = "paper_base"
    overrides: tuple[str, ...] = ()
    seed: int | None = None
    logged: bool = False


def pieces(radius: float, speed: float = 30.0, width: float = LANE) -> tuple[float, float]:
    """Length (m) of each arc of a lane change, and of the straight between them.

    An arc lasts a second, unless two of them without a straight move the car too far already.
    """
    angle = speed / radius
    sideways = 2.0 * radius * (1.0 - cos(angle))
    if sideways >= width:
        return radius * acos(1.0 - 0.5 * width / radius), 0.0
    straight = (width - sideways) / sin(angle)
    return speed, straight if straight >= SHORTEST else 0.0


def road(radius: float, arc: float, straight: float, begins: tuple[float, float]) -> str:
    """Override that lays two lane changes, to the right and back, which begin at two places (m)."""

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
    """Overrides for a road on which `speed` (m/s) gives the same times as 30 m/s on the usual one.

    Every piece lasts a second, so the radius is 2 v² / 3.6: the lateral acceleration stays.
    """
    radius = 2.0 * speed**2 / LANE
    where = (5.0 * speed, 20.0 * speed)
    return (road(radius, speed, speed, where), "duration_s=15.0")


def _noisy(key: str, scenario: str, seeds: int, *changes: str) -> dict[str, Experiment]:
    return {
        f"{key}/noise/{seed}": Experiment(
            scenario=scenario, overrides=(*changes, *NOISE), seed=seed
        )
        for seed in range(1, seeds + 1)
    }


def _shifted(key: str) -> dict[str, Experiment]:
    """The case on its own road, moved along by shares of the way between two samples."""
    speed, begins = ROADS[key]
    found = {}
    for phase in PHASES:
        moved = phase * SAMPLING_S * speed
        place = road(500.0, 30.0, 30.0, (begins[0] + moved, begins[1] + moved))
        found[f"{key}/phase/{phase:g}"] = Experiment(scenario=f"paper_{key}", overrides=(place,))
    return found


def _repeated(key: str, seeds: int, *until: str) -> dict[str, Experiment]:
    """A case of the paper, exact and logged; moved along its road; and with noise."""
    name = f"paper_{key}"
    return {
        key: Experiment(scenario=name, logged=True),
        **_shifted(key),
        **_noisy(key, name, seeds, *until),
    }


def _paper(key: str) -> dict[str, Experiment]:
    """One of the paper's other cases, and the same with a trajectory for each source."""
    name, until = f"paper_{key}", f"duration_s={FIRST_CHANGE_S[key]}"
    return {
        **_repeated(key, OTHER_SEEDS, until),
        f"{key}/blend": Experiment(scenario=name, overrides=('control.fusion="blend"', until)),
    }


def _variant(*changes: str) -> Experiment:
    return Experiment(overrides=(*FIRST_CHANGE, *changes))


def _base() -> dict[str, Experiment]:
    return {
        **_repeated("base", EXACT_SEEDS),
        "base/as_is": _variant(),
        "base/blend": _variant('control.fusion="blend"'),
        "base/lead_only": _variant("control.alpha_ratio=0.0"),
        "base/slip_compensated": _variant(*SLIP_COMPENSATED),
        "base/slip_compensated_knows_loading": _variant(
            *SLIP_COMPENSATED, "control.knows_loading=true"
        ),
        "base/knows_loading": _variant("control.knows_loading=true"),
        "base/gap_25_m": _variant("convoy.gap_m=25.0"),
        "base/own_state_at_50_hz": _variant(*OWN_STATE_AT_50_HZ),
    }


def _a_or_c(key: str, speed: float) -> dict[str, Experiment]:
    name, until = f"paper_{key}", f"duration_s={FIRST_CHANGE_S[key]}"
    return {
        **_paper(key),
        f"{key}/same_times": Experiment(scenario=name, overrides=at_the_same_times(speed)),
        f"{key}/slip_compensated": Experiment(scenario=name, overrides=(*SLIP_COMPENSATED, until)),
    }


def _lead_data() -> dict[str, Experiment]:
    long = ("convoy.vehicles=8", "duration_s=17.0")
    return {
        **_repeated("base", EXACT_SEEDS),
        "no_lead_data": Experiment(overrides=NO_LEAD_DATA, logged=True),
        **_noisy("no_lead_data", "paper_base", EXACT_SEEDS, *NO_LEAD_DATA),
        "long/with": Experiment(overrides=long),
        "long/without": Experiment(overrides=(*long, *NO_LEAD_DATA)),
    }


def _radius() -> dict[str, Experiment]:
    found = {}
    for radius in RADII:
        arc, straight = pieces(radius)
        length = 2.0 * arc + straight
        until = f"duration_s={5.0 + length / 30.0 + 6.0:.1f}"
        changes = (*SWERVE, road(radius, arc, straight, (150.0, 300.0 + length)), until)
        key = f"radius/{radius:g}"
        found[key] = Experiment(overrides=changes)
        found[f"{key}/no_lead_data"] = Experiment(overrides=(*changes, *NO_LEAD_DATA))
        found[f"{key}/slip_compensated"] = Experiment(overrides=(*changes, *SLIP_COMPENSATED))
        found |= _noisy(key, "paper_base", 2, *changes)
    return found


def _field() -> dict[str, Experiment]:
    """Noisy repetitions; live convoys, since a replayed car is heard as a live one is."""
    found = {}
    for seed in range(2, 2 + FIELD_SEEDS):
        found[f"field/with/noise/{seed}"] = Experiment(scenario="paper_field", seed=seed)
        found[f"field/without/noise/{seed}"] = Experiment(
            scenario="paper_field", seed=seed, overrides=NO_LEAD_DATA
        )
    return found


CASES: Mapping[str, Mapping[str, Experiment]] = {
    "base": _base(),
    "a": _a_or_c("a", 10.0),
    "b": _paper("b"),
    "c": _a_or_c("c", 20.0),
    "d": _paper("d"),
    "variable_speed": _paper("variable_speed"),
    "lead_data": _lead_data(),
    "radius": _radius(),
    "propagation": {},
    "gains": {},
    "field": _field(),
}
"""The runs of each case by their keys; `propagation`, `gains` and `field` are more than runs."""
