"""Which vehicle carries out a change."""

from collections.abc import Iterable, Sequence

from scenarios.definition.changing.links import LINK_CHANGES, links_of
from scenarios.definition.schema.changes import AnyChange, SpeedChangeTable


def concerns(
    change: AnyChange, vehicle: str, names: Sequence[str], links: Iterable[tuple[str, str]]
) -> bool:
    """Whether `vehicle` of a convoy of `names` with these `links` carries out a change.

    That is of a link its receiver, and of the speed the lead.
    """
    if isinstance(change, LINK_CHANGES):
        return any(receiver == vehicle for _, receiver in links_of(change, names, links))
    if isinstance(change, SpeedChangeTable):
        return vehicle == names[0]
    return vehicle == change.vehicle
