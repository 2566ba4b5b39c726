"""The key of the rule that made a link drop a message."""

from collections.abc import Iterator

from scenarios.definition.channel.rules import entries_about
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.link_tables import LinkEntry
from scenarios.definition.schema.scenario_tables import ScenarioTables
from transport.links.laws.registry import KEY_OF_REASON

OF_VEHICLES = {"transmitter_off": 0, "receiver_off": 1}
"""Reasons that are keys of the vehicle at one end of the link."""


def origin(tables: ScenarioTables, link: tuple[str, str], reason: str) -> str:
    """Return the key that makes `link` (sender, receiver) drop messages for `reason`.

    Such as `links.loss_ratio = 0.4`, or `link[1].loss_ratio = 0.4 (lead → *)`; the reason itself if
    no key is known.
    """
    if reason in OF_VEHICLES:
        return f"vehicle.{link[OF_VEHICLES[reason]]}.{reason}"
    key = KEY_OF_REASON.get(reason)
    return reason if key is None else source_key(tables, link, key)


def source_key(tables: ScenarioTables, link: tuple[str, str], key: str) -> str:
    """Return the rule that gives `key` of a link, with its value if that is a number or a word."""
    for entry in _entries(tables, link):
        if key in entry.model_fields_set or entry.preset:
            key = key if key in entry.model_fields_set else "preset"
            place = _place(tables, entry)
            return f"{place}.{key}{_value(entry, key)} ({entry.sender} → {entry.receiver})"
    return f"links.{key}{_value(tables.links, key)}"


def rules_of(tables: ScenarioTables, link: tuple[str, str]) -> Iterator[str]:
    for entry in _entries(tables, link):
        yield f"{_place(tables, entry)} ({entry.sender} → {entry.receiver})"
        if entry.preset:
            return
    yield "links"


def _entries(tables: ScenarioTables, link: tuple[str, str]) -> list[LinkEntry]:
    """Return the entries of a link, the most specific first."""
    about = entries_about(tables.link, vehicle_names(tables), *link)
    return [entry for _, entry in reversed(about)]


def _place(tables: ScenarioTables, entry: LinkEntry) -> str:
    return f"link[{next(place for place, one in enumerate(tables.link) if one is entry)}]"


def _value(table: object, key: str) -> str:
    value = getattr(table, key)
    if isinstance(value, int | float | str):
        return f" = {value:g}" if isinstance(value, float) else f" = {value}"
    kind = getattr(value, "kind", "")
    return f" ({kind})" if kind else ""
