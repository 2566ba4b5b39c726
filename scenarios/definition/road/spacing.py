"""Gaps between bumpers, as configured, and spacings between centres of mass, as kept.

A car reaches as far beyond its front axle as beyond its rear one.
"""

from collections.abc import Sequence
from itertools import pairwise

from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.vehicle_setup import VehicleSetup, empty_car
from vehicles.car.parameters import least_spacing
from vehicles.driver.longitudinal.spacing import SpacingPolicy

DEFAULT_GAP = 10.0
"""Gap (m) at the start where the scenario gives none: a third of a second at 30 m/s."""


def least_spacings(tables: ScenarioTables) -> tuple[float, ...]:
    """Spacing (m) to the predecessor at which the bumpers touch; 0 for the lead."""
    cars = [empty_car(tables, name) for name in tables.convoy.vehicle_names]
    return (0.0, *(least_spacing(ahead, behind) for ahead, behind in pairwise(cars)))


def spacing_policy(tables: ScenarioTables, least: float) -> SpacingPolicy:
    """Return the policy of `[speed.gap]` for a pair whose bumpers touch at the spacing `least`."""
    gap = tables.speed.gap
    return SpacingPolicy(gap.standstill_m + least, gap.headway_s)


def source_policies(tables: ScenarioTables, setup: VehicleSetup) -> dict[str, SpacingPolicy]:
    """Spacing of a follower to each longitudinal source, negative to those behind."""
    names, least = tables.convoy.vehicle_names, least_spacings(tables)
    policies = {}
    for name in setup.flow.longitudinal:
        place = names.index(name)
        first, last = sorted((place, setup.place))
        between = [spacing_policy(tables, least[one]) for one in range(last, first, -1)]
        sign = 1.0 if place < setup.place else -1.0
        policies[name] = SpacingPolicy(
            sign * sum([one.standstill for one in between]),
            sign * sum([one.headway for one in between]),
        )
    return policies


def gaps_at(tables: ScenarioTables, speed: float) -> tuple[float, ...]:
    """Gaps (m) to the predecessor at the start, at `speed` (m/s); 0 for the lead."""
    return _distances(tables, speed, [0.0] * len(tables.convoy.vehicle_names))


def spacings_at(tables: ScenarioTables, speed: float) -> tuple[float, ...]:
    """Spacings (m) to the predecessor at the start, at `speed` (m/s); 0 for the lead."""
    return _distances(tables, speed, least_spacings(tables))


def _distances(tables: ScenarioTables, speed: float, least: Sequence[float]) -> tuple[float, ...]:
    """Sum `least` and the gap of each follower: its own, the convoy's, the kept or the default."""
    kept = tables.speed.followers == "gap"
    usual = tables.convoy.gap_m
    if usual is None and not kept:
        usual = DEFAULT_GAP
    distances = [0.0]
    for name, touching in zip(tables.convoy.vehicle_names[1:], least[1:], strict=True):
        own = tables.vehicle.get(name)
        gap = usual if own is None or own.gap_m is None else own.gap_m
        policy = spacing_policy(tables, touching)
        distances.append(policy.desired(speed) if gap is None else gap + touching)
    return tuple(distances)
