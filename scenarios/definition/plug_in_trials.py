"""Classes that a scenario selects are constructed and called before the run."""

from collections.abc import Iterator

from scenarios.definition.errors import Problem
from scenarios.definition.road.spacing import least_spacings, spacing_policy
from scenarios.definition.schema.plug_ins.guards import PlugInError
from scenarios.definition.schema.plug_ins.table import PlugInTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.validation.wording import toml_repr
from scenarios.definition.vehicle_setup import vehicle_setup
from vehicles.driver.longitudinal.controller import LongitudinalSetup
from vehicles.driver.longitudinal.spacing import GapLimits


def plug_in_problems(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield the classes that violate their contract, by their keys."""
    problems: dict[str, str] = {}
    least = least_spacings(tables)
    for place, name in enumerate(tables.convoy.vehicle_names):
        setup, own = vehicle_setup(tables, name), tables.vehicle.get(name)
        key = f"vehicle.{name}.control" if own and own.control else "control"
        table = setup.steering.controller
        arguments: tuple[object, ...] = (setup.assumed_parameters, setup.gains)
        problems |= _problem(f"{key}.controller", table, arguments)
        if place and tables.speed.followers != "gap" and setup.steering.longitudinal.is_own:
            problems[f"{key}.longitudinal"] = (
                f"given {setup.steering.longitudinal.use}, but speed.followers = "
                f'{toml_repr(tables.speed.followers)}, allowed with "gap"'
            )
        elif place and tables.speed.followers == "gap":
            start = LongitudinalSetup(
                spacing_policy(tables, least[place]),
                GapLimits(),
                least[place],
                1.0 / tables.control.rate_hz,
                tables.speed.set_mps,
                setup.assumed_parameters,
                setup.lead,
                setup.predecessor or "",
            )
            table = setup.steering.longitudinal
            problems |= _problem(f"{key}.longitudinal", table, (start,), start)
    yield from problems.items()


def _problem(
    key: str, table: PlugInTable, arguments: tuple[object, ...], *trial: object
) -> dict[str, str]:
    """Return the problem of a class by its key, if it has one; shipped classes have none.

    Equal calls of two instances must have equal results.
    """
    if not table.is_own:
        return {}
    try:
        results = [table.point.trial(table.build(*arguments), *trial) for _ in range(2)]
    except PlugInError as error:
        return {key: str(error)}
    if results[0] != results[1]:
        what = f"{table.point.name} {table.use!r}"
        return {
            key: f"{what}: results differ between equal calls: it must not use a clock or random "
            "numbers of its own"
        }
    return {}
