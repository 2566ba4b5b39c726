"""Which vehicles each vehicle receives from, and what the scenario asks of each directed link."""

from collections.abc import Sequence
from fractions import Fraction

from scenarios.definition.schema.table import overlay
from scenarios.definition.schema.tables import LinkEntry, LinkTable, ScenarioTables
from transport.links.effects import Decimation, Effect, Jitter, Latency, Loss
from vehicles.schedule import MILLISECOND

ANY = "*"
"""Stands for every vehicle in a link's `sender` or `receiver`."""


def senders_to(names: Sequence[str], receiver: str) -> tuple[str, ...]:
    """Vehicles whose poses `receiver` uses, of a convoy of `names`: the lead and its predecessor.

    The lead has no senders, the first follower the lead alone.
    """
    place = names.index(receiver)
    return tuple(dict.fromkeys((names[0], names[place - 1]))) if place else ()


def directed_links(names: Sequence[str]) -> tuple[tuple[str, str], ...]:
    """Sender and receiver of every link, by receiver from the lead back."""
    return tuple((sender, receiver) for receiver in names for sender in senders_to(names, receiver))


def is_about(entry: LinkEntry, sender: str, receiver: str) -> bool:
    """Whether an entry of the scenario is about the link from `sender` to `receiver`."""
    return entry.sender in {sender, ANY} and entry.receiver in {receiver, ANY}


def requested_link(tables: ScenarioTables, sender: str, receiver: str) -> LinkTable:
    """What is asked of one link: the convoy's values and those of its entries; later ones win."""
    link = tables.links
    for entry in tables.link:
        if is_about(entry, sender, receiver):
            link = overlay(link, entry)
    return link


def link_effects(table: LinkTable, source_rate_hz: float) -> tuple[Effect, ...]:
    """Impairments that `table` asks of a link whose sender measures at `source_rate_hz`.

    The first that drops a message names the reason.
    """
    found: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        found.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    if table.loss_ratio > 0.0:
        found.append(Loss(table.loss_ratio))
    found.append(Latency(round(table.latency_ms * MILLISECOND)))
    if table.jitter_ms > 0.0:
        found.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    return tuple(found)
