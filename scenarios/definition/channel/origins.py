"""Which key of which rule of a scenario is behind what a link did."""

from scenarios.definition.channel.rules import entries_about
from scenarios.definition.schema.tables import ScenarioTables

KEYS = {
    "rate": "rate_hz",
    "loss": "loss_ratio",
    "burst": "loss",
    "pattern": "loss",
    "collision": "collisions",
    "range": "radio",
    "outage": "outages",
    "queue": "queue",
    "corrupted": "content",
}
"""The key of a link that makes it drop a message, by the reason that is given."""
OF_VEHICLES = {"transmitter_off": 0, "receiver_off": 1}
"""Reasons that are keys of the vehicle at the one or the other end of the link."""


def origin(tables: ScenarioTables, link: tuple[str, str], reason: str) -> str:
    """Name what in the scenario makes `link` (sender, receiver) drop a message for `reason`.

    Such as `links.loss_ratio = 0.4`, or `link[1].loss_ratio = 0.4 (lead → *)`. The reason itself
    where no key is known to be behind it.
    """
    if reason in OF_VEHICLES:
        return f"vehicle.{link[OF_VEHICLES[reason]]}.{reason}"
    key = KEYS.get(reason)
    return reason if key is None else giver(tables, link, key)


def giver(tables: ScenarioTables, link: tuple[str, str], key: str) -> str:
    """Name the rule that gives `key` of a link, with its value where that is one number or word."""
    entries = list(tables.link)
    about = entries_about(entries, tables.convoy.vehicle_names, *link)
    given = [entry for _, entry in about if key in entry.model_fields_set]
    if not given:
        return f"links.{key}{_value(tables.links, key)}"
    entry = given[-1]
    number = next(place for place, one in enumerate(entries) if one is entry)
    who = f"{entry.sender} → {entry.receiver}"
    return f"link[{number}].{key}{_value(entry, key)} ({who})"


def _value(table: object, key: str) -> str:
    value = getattr(table, key)
    if isinstance(value, int | float | str):
        return f" = {value:g}" if isinstance(value, float) else f" = {value}"
    kind = getattr(value, "kind", "")
    return f" ({kind})" if kind else ""
