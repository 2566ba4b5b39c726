"""Classes that a scenario selects are constructed and called before the run."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from scenarios.definition.errors import Problem
from scenarios.definition.road.spacing import least_spacings, source_policies, spacing_policy
from scenarios.definition.schema.plug_ins.channel import try_law
from scenarios.definition.schema.plug_ins.emission import try_error, try_rule
from scenarios.definition.schema.plug_ins.guards import PlugInError, own_name
from scenarios.definition.schema.plug_ins.table import PlugInTable, own_classes
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.validation.wording import toml_repr
from scenarios.definition.vehicle_setup import VehicleSetup, vehicle_setup
from transport.links.laws.link_law import LinkSetting
from vehicles.car.positioning.error_term import ReceiverContext
from vehicles.car.sending.rule import SendingContext
from vehicles.driver.longitudinal.controller import LongitudinalSetup
from vehicles.driver.longitudinal.spacing import GapLimits
from vehicles.geometry.geodesy import LocalPlane, Origin

Trial = Callable[[], object]
USUAL_LAW = "gap"
DETERMINISTIC = "a class must not use a clock or random numbers of its own"


def plug_in_problems(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield classes that violate their contract or refuse their parameters, by their keys."""
    controls = [tables.control, *(own.control for own in tables.vehicle.values())]
    laws = {control.longitudinal.use for control in controls if control}
    if laws != {USUAL_LAW} or any(own_classes(tables)):
        yield from _problems(tables)


def _problems(tables: ScenarioTables) -> Iterator[Problem]:
    problems: dict[str, str] = {}
    for name in tables.convoy.vehicle_names:
        setup = vehicle_setup(tables, name)
        for key, trial in (*_controllers(tables, setup), *_sensors(tables, setup)):
            problems |= _problem(key, trial)
        longitudinal = setup.steering.longitudinal
        if tables.speed.followers != "gap" and longitudinal.use != USUAL_LAW:
            problems[_key(tables, name, "control", "longitudinal")] = (
                f"given {longitudinal.use}, but speed.followers = "
                f'{toml_repr(tables.speed.followers)}, allowed with "gap"'
            )
    for key, trial in (*_laws(tables), *_measures(tables)):
        problems |= _problem(key, trial)
    yield from problems.items()


def _controllers(tables: ScenarioTables, setup: VehicleSetup) -> Iterator[tuple[str, Trial]]:
    name = setup.name
    lateral, longitudinal = setup.steering.controller, setup.steering.longitudinal
    if lateral.is_own:
        yield (
            _key(tables, name, "control", "controller"),
            lambda: lateral.point.trial(setup.controller()),
        )
    reaction = setup.steering.degradation.reaction
    for inner, table in (("fusion", setup.steering.fusion), ("degradation", reaction)):
        if table.is_own:
            key = _key(tables, name, "control", inner)
            key += ".reaction" if inner == "degradation" else ""
            yield key, partial(_try_built, table)
    if longitudinal.use != USUAL_LAW and setup.place and tables.speed.followers == "gap":
        least = least_spacings(tables)[setup.place]
        start = LongitudinalSetup(
            spacing_policy(tables, least),
            GapLimits(),
            least,
            1.0 / tables.control.rate_hz,
            tables.speed.set_mps,
            setup.assumed_parameters,
            setup.lead,
            setup.predecessor or "",
            source_policies(tables, setup),
        )
        yield (
            _key(tables, name, "control", "longitudinal"),
            lambda: longitudinal.point.trial(longitudinal.build(start), start),
        )


def _try_built(table: PlugInTable) -> object:
    return table.point.trial(table.build())


def _sensors(tables: ScenarioTables, setup: VehicleSetup) -> Iterator[tuple[str, Trial]]:
    rule = setup.sending
    if own_name(rule):
        context = SendingContext(0, _streams)
        yield _key(tables, setup.name, "sending"), lambda: try_rule(rule, context)
    start = ReceiverContext(0, 0.0, _streams, _streams)
    for index, term in enumerate(setup.gnss.errors):
        if own_name(term):
            key = _key(tables, setup.name, "gnss", "errors")
            yield f"{key}[{index}]", partial(try_error, term, start)


def _laws(tables: ScenarioTables) -> Iterator[tuple[str, Trial]]:
    setting = LinkSetting(plane=LocalPlane(Origin(0.0, 0.0, 0.0)))
    links = {"links": tables.links} | {f"link[{k}]": one for k, one in enumerate(tables.link)}
    for key, link in links.items():
        for inner, law in (("loss", link.loss), ("delay", link.delay)):
            if law is not None and any(own_classes(law)):
                yield f"{key}.{inner}", partial(try_law, law, setting)


def _measures(tables: ScenarioTables) -> Iterator[tuple[str, Trial]]:
    for key, entries in (("event", tables.event), ("figure", tables.figure)):
        names = [table.class_name for table in entries]
        for index, table in enumerate(entries):
            if table.class_name in names[:index]:
                yield f"{key}[{index}]", partial(_refuse_name, table)
            else:
                yield f"{key}[{index}]", partial(_try_built, table)


def _refuse_name(table: PlugInTable) -> None:
    raise PlugInError(
        f"{table.point.name} {table.use!r}: given {table.class_name} twice, allowed one class of a "
        "name; inherit from it under another name"
    )


def _streams(purpose: str) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(list(purpose.encode())))


def _key(tables: ScenarioTables, name: str, table: str, key: str = "") -> str:
    """Key of a setting of a vehicle: its own, or that of all vehicles."""
    own = getattr(tables.vehicle.get(name), table, None)
    is_own = own is not None and (not key or key in own.model_fields_set)
    return ".".join(filter(None, (f"vehicle.{name}" if is_own else "", table, key)))


def _problem(key: str, trial: Trial) -> dict[str, str]:
    """Return what is wrong with a class, by its key; equal calls must have equal results."""
    try:
        if trial() == trial():
            return {}
    except PlugInError as error:
        return {key: str(error)}
    return {key: "results differ between equal calls: " + DETERMINISTIC}
