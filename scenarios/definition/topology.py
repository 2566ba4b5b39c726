"""Information flow: the vehicles whose poses each vehicle receives, and their use."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from scenarios.definition.errors import Problem
from scenarios.definition.schema.link_tables import InformationFlowTable, SourcesTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import overlay
from scenarios.definition.wording import toml_repr

DIRECTIONS = ("lateral", "longitudinal")
"""Directions of control, each with its own sources."""
_USUAL = InformationFlowTable()


@dataclass(frozen=True, slots=True)
class InformationFlow:
    """Vehicles whose poses a vehicle uses, from front to back.

    Followers steer along the `lateral` ones; their longitudinal controllers use the `longitudinal`
    ones. `others` are those that a lead receives, which waits for them, keeps its distance, or
    repeats their announced stops.
    """

    lateral: tuple[str, ...] = ()
    longitudinal: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    def use_of(self, name: str) -> str:
        """Directions of control that use a vehicle; empty for those that a lead receives."""
        return " and ".join(one for one in DIRECTIONS if name in getattr(self, one))

    def received(self, names: Sequence[str]) -> tuple[str, ...]:
        """All of them, in the order of the convoy `names`."""
        used = {*self.lateral, *self.longitudinal, *self.others}
        return tuple(name for name in names if name in used)


def information_flow(tables: ScenarioTables, name: str) -> InformationFlow:
    """Return the vehicles that the vehicle `name` uses."""
    names = tables.convoy.vehicle_names
    place = names.index(name)
    if not place:
        if tables.speed.lead_receives:
            return InformationFlow(others=names[1:])
        return InformationFlow(others=names[1:-1] if relays_stops(tables) else ())
    lateral, longitudinal = (
        getattr(_table_of(tables, name, one), one).of(names, place) for one in DIRECTIONS
    )
    return InformationFlow(lateral, longitudinal)


def relays_stops(tables: ScenarioTables) -> bool:
    """Whether the lead repeats the announced stops of its followers, so that some can react."""
    names = tables.convoy.vehicle_names
    if names[0] in tables.replayed:
        return False
    for name in names[2:]:
        own = tables.vehicle.get(name)
        control = overlay(tables.control, own and own.control)
        if control.degradation.reaction_word == "degrade":  # also if replayed, to repeat a run
            return True
    return False


def _table_of(tables: ScenarioTables, name: str, direction: str) -> InformationFlowTable:
    own = tables.vehicle.get(name)
    table = own.information_flow if own else None
    given = table is not None and direction in table.model_fields_set
    return table if table is not None and given else tables.information_flow


def directed_links(tables: ScenarioTables) -> tuple[tuple[str, str], ...]:
    """Return each link (sender, receiver): the sources of both directions of control."""
    names = tables.convoy.vehicle_names
    return tuple(
        (sender, receiver)
        for receiver in names
        for sender in information_flow(tables, receiver).received(names)
    )


def usual_links(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Return the links of a convoy of unknown information flow: from lead and predecessor."""
    return tuple(
        (sender, receiver)
        for place, receiver in enumerate(names)
        if place
        for sender in _USUAL.lateral.of(names, place)
    )


def no_link(tables: ScenarioTables, sender: str, receiver: str) -> str:
    """Explain that no link joins two ends, each a vehicle, a role or any."""
    names = tables.convoy.vehicle_names
    text = f"from {sender} to {receiver}: no such link"
    if receiver in names:
        received = information_flow(tables, receiver).received(names)
        return f"{text}, {receiver} receives from {', '.join(received) or 'none'}"
    pairs = [f"{one} to {other}" for one, other in directed_links(tables)]
    return f"{text}, allowed {', '.join(pairs[:8])}{', …' if pairs[8:] else ''}"


def flow_problems(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield sources that do not exist, that a direction cannot use, or that are missing."""
    names = tables.convoy.vehicle_names
    own = tables.vehicle.get(names[0])
    if own is not None and own.information_flow is not None:
        yield f"vehicle.{names[0]}.information_flow", "given for the lead, which follows its path"
    problems: dict[str, str] = {}
    for name in names[1:]:
        for direction in () if name in tables.replayed else DIRECTIONS:
            table = _table_of(tables, name, direction)
            place = "information_flow"
            if table is not tables.information_flow:
                place = f"vehicle.{name}.{place}"
            for why in _direction_problems(names, name, direction, getattr(table, direction)):
                problems.setdefault(f"{place}.{direction}", why)
    yield from problems.items()


def _direction_problems(
    names: Sequence[str], name: str, direction: str, sources: SourcesTable
) -> Iterator[str]:
    unknown = [other for other in sources.names if other not in names]
    if unknown:
        yield f"given {toml_repr(unknown[0])}, no such vehicle, allowed {', '.join(names)}"
        return
    place = names.index(name)
    if name in sources.names:
        yield f"given {toml_repr(name)} for {name} itself, allowed other vehicles"
        return
    used = sources.of(names, place)
    if not used:
        yield f"given no source of {name}, allowed at least one other vehicle"
    elif direction == "lateral" and (sources.behind or names.index(used[-1]) > place):
        behind = sources.word or next((one for one in used if names.index(one) > place), "behind")
        yield (
            f"given {toml_repr(behind)}: {name} cannot steer along vehicles behind it, allowed "
            "vehicles ahead"
        )
