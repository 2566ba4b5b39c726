"""Which vehicle carries out a change."""

from collections.abc import Iterable

from scenarios.definition.changing.links import LINK_CHANGES, links_of
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.changes import AnyChange, SpeedChangeTable
from scenarios.definition.schema.tables import ScenarioTables


def concerns(
    change: AnyChange, vehicle: str, tables: ScenarioTables, links: Iterable[tuple[str, str]]
) -> bool:
    """Whether `vehicle` of a convoy with these `links` carries out a change.

    That is of a link its receiver, and of the speed the lead and those that drive the same speed.
    """
    names = vehicle_names(tables)
    if isinstance(change, LINK_CHANGES):
        return any(receiver == vehicle for _, receiver in links_of(change, names, links))
    if isinstance(change, SpeedChangeTable):
        return vehicle == names[0] or tables.speed.followers == "same"
    return vehicle == change.vehicle
