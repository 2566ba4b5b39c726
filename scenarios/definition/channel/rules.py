"""The entries of a scenario that apply to a directed link, and the merged settings."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from scenarios.definition.schema.base_table import overlay
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.topology import directed_links, no_link
from scenarios.definition.validation.wording import toml_repr

ANY = "*"
"""Stands for every vehicle in a link's `sender` or `receiver`."""
ROLES = ("lead", "predecessor", "follower")
"""Vehicles by their place; a vehicle with such a name takes precedence over the role."""
_BY_NAME, _BY_ROLE, _BY_ANY = 2, 1, 0


class Ends(Protocol):
    """The links that an entry applies to."""

    @property
    def sender(self) -> str:
        """A vehicle's name, a role, or "*"."""

    @property
    def receiver(self) -> str:
        """Likewise."""


def specificity(entry: Ends, names: Sequence[str], sender: str, receiver: str) -> int | None:
    """Return how specific an entry is for a link, None if it does not apply.

    Each end counts 2 by name, 1 by role and 0 for "*".
    """
    ends = _end(entry.sender, sender, names, receiver), _end(entry.receiver, receiver, names, "")
    return None if None in ends else sum(filter(None, ends))


def _end(given: str, vehicle: str, names: Sequence[str], receiver: str) -> int | None:
    if given == ANY:
        return _BY_ANY
    if given in names:
        return _BY_NAME if given == vehicle else None
    place = names.index(vehicle)
    ahead = bool(receiver) and place == names.index(receiver) - 1
    fits = {"lead": place == 0, "predecessor": ahead, "follower": place > 0}
    return _BY_ROLE if fits.get(given, False) else None


def end_problems(entry: Ends, tables: ScenarioTables) -> Iterator[tuple[str, str]]:
    """Yield ends that name no vehicle, by ".sender" or ".receiver"; by "" if no link matches."""
    names = tables.convoy.vehicle_names
    known = list(dict.fromkeys((*names, *ROLES, ANY)))
    given = {".sender": entry.sender, ".receiver": entry.receiver}
    unknown = {key: end for key, end in given.items() if end not in known}
    for key, end in unknown.items():
        yield key, f"given {toml_repr(end)}, allowed {', '.join(map(toml_repr, known))}"
    links = directed_links(tables)
    if not unknown and all(specificity(entry, names, *pair) is None for pair in links):
        yield "", no_link(tables, entry.sender, entry.receiver)


def requested_link(
    tables: ScenarioTables, names: Sequence[str], sender: str, receiver: str
) -> LinkTable:
    """Merge the settings of one link: [links], then its entries by specificity, key by key.

    An entry with a preset replaces everything below it, since a preset is a complete channel.
    """
    link = tables.links
    for _, entry in entries_about(tables.link, names, sender, receiver):
        link = overlay(LinkTable() if entry.preset else link, entry)
    return link


def entries_about(
    entries: Sequence[LinkEntry], names: Sequence[str], sender: str, receiver: str
) -> list[tuple[int, LinkEntry]]:
    """Return the entries of a link with their specificity, the least specific first."""
    result = [(specificity(entry, names, sender, receiver), entry) for entry in entries]
    about = [(grade, entry) for grade, entry in result if grade is not None]
    return sorted(about, key=lambda one: one[0])


def ties(tables: ScenarioTables) -> Iterator[tuple[int, int, str]]:
    """Yield the numbers of two entries that are equally specific for a link, and a key of both."""
    entries, names = tables.link, tables.convoy.vehicle_names
    seen: set[tuple[int, int]] = set()
    for sender, receiver in directed_links(tables):
        graded = [specificity(entry, names, sender, receiver) for entry in entries]
        for later, grade in enumerate(graded):
            for first in range(later):
                if grade is None or graded[first] != grade or (first, later) in seen:
                    continue
                if both := _keys(entries[first]) & _keys(entries[later]):
                    seen.add((first, later))
                    yield first, later, "preset" if "preset" in both else min(both)


def _keys(entry: LinkEntry) -> set[str]:
    """Return the keys that an entry gives; all with a preset."""
    every = set(LinkTable.model_fields)
    return every if entry.preset else entry.model_fields_set & every
