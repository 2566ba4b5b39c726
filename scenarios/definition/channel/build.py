"""The effects and stages of a directed link, from its table."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf, prod, sqrt
from typing import Protocol

import numpy as np

from scenarios.definition.road.route import Route, vehicle_names
from scenarios.definition.schema.link_tables import LinkEntry, LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import overlay
from scenarios.definition.topology import directed_links, no_link
from scenarios.definition.wording import toml_repr
from transport.links.content_stage import ContentStage
from transport.links.laws.basic import Decimation, Jitter, Latency, Loss
from transport.links.laws.content import ContentLaw
from transport.links.laws.link_law import (
    Effect,
    LinkLaw,
    LinkSetting,
    Losses,
    Road,
    StageLaw,
    VehiclesBetween,
    no_vehicles,
)
from transport.links.laws.registry import KEY_OF_REASON
from transport.links.link import Link, PoseGate
from vehicles.geometry.sampled_path import SampledPath
from vehicles.schedule import MILLISECOND

# ---- The entries of a scenario that apply to a directed link, and the merged settings


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


# ---- Build


UNSET = LinkSetting()
"""For links without outages, or at time 0."""

ROAD_STEP = 2.0
"""Distance (m) between samples of the road for vehicles in between."""

Between = Callable[[], VehiclesBetween]
"""Returns the vehicles between sender and receiver, and their road."""


def link_effects(
    table: LinkTable,
    source_rate_hz: float,
    setting: LinkSetting = UNSET,
    between: Between = no_vehicles,
    besides: Sequence[Effect] = (),
) -> tuple[Effect, ...]:
    """Build the effects of a link whose sender sends at `source_rate_hz`.

    The first effect that drops a message names the reason. `between` returns the vehicles between
    the ends. `besides` are additional effects after the rate of the link.
    """
    latency = round(table.latency_ms * MILLISECOND)
    setting = replace(setting, between=between, latency=latency)
    if table.loss is not None and table.loss.replaces_others:
        return (*table.loss.effects(setting), *besides)
    result: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        result.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    result += _of(setting, *setting.radio_off)
    result += besides
    result += _of(setting, *(table.outages or ()))
    if table.loss_ratio > 0.0:
        result.append(Loss(table.loss_ratio))
    result += _of(setting, table.loss, table.collisions, table.radio)
    result.append(Latency(latency))
    if table.jitter_ms > 0.0:
        result.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    result += _of(setting, table.delay, table.content)
    return tuple(result)


def _of(setting: LinkSetting, *laws: LinkLaw | None) -> list[Effect]:
    return [
        effect
        for place, law in enumerate(laws)
        if law is not None
        for effect in law.effects(replace(setting, place=place))
    ]


def link_stages(table: LinkTable) -> tuple[StageLaw, ...]:
    return tuple(stage for law in (table.queue, table.delay) if law for stage in law.stages)


def content_stage(law: ContentLaw | None, link: Link, gate: PoseGate) -> ContentStage | None:
    if law is None or not law.alters_messages:
        return None
    setting = LinkSetting(start_at=gate.start_at, source_rate_hz=gate.rate_hz)
    return ContentStage(
        link=link,
        gate=gate,
        duplication=law.duplication,
        filters=law.filter_duplicates,
        bit_errors=law.bit_errors,
        false=tuple(one.for_link(setting) for one in law.false),
    )


def usual_delay_ms(table: LinkTable) -> float:
    """Return a delay that most messages do not exceed: largest jitter, and mean + 2 σ of a law."""
    beyond = 0.0 if table.delay is None else table.delay.typical_max_ns / MILLISECOND
    return table.latency_ms + table.jitter_ms + beyond


def vehicles_between(route: Route, sender: int, receiver: int) -> VehiclesBetween:
    first = float(route.path.station[0])
    return VehiclesBetween(
        count=max(abs(receiver - sender) - 1, 0),
        road=_road(route.path),
        sender_start=route.start_station(sender) - first,
        receiver_start=route.start_station(receiver) - first,
    )


def _road(path: SampledPath) -> Road:
    """Sample a path, with a straight extension at its end."""
    first, count = float(path.station[0]), int(path.length / ROAD_STEP) + 1
    nodes = first + ROAD_STEP * np.arange(count)
    beyond = [path.at(first + ROAD_STEP * (count + more)) for more in (0, 1)]
    return Road(
        ROAD_STEP,
        (*np.interp(nodes, path.station, path.east).tolist(), *(point.east for point in beyond)),
        (*np.interp(nodes, path.station, path.north).tolist(), *(point.north for point in beyond)),
    )


# ---- The key of the rule that made a link drop a message


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


# ---- Expected loss, bursts, delay and age of a link, as far as its laws determine them


USUAL_MESSAGE_BYTES = 240
"""Mean size of poses with the default path history; without a history they have 160 bytes."""
FASTEST_HZ = 1000.0
"""Highest rate of a source, so that the rate of a link is always an upper bound."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedChannel:
    """Long-run mean loss, mean burst, mean and standard deviation of the delay (ms).

    Unknown figures are None, such as a loss that depends on the distance.
    """

    loss_ratio: float | None
    burst_messages: float | None
    latency_ms_mean: float | None
    latency_ms_deviation: float | None


def expected_channel(
    table: LinkTable,
    source_rate_hz: float = FASTEST_HZ,
    distance_m: float | None = None,
    between: Between = no_vehicles,
) -> ExpectedChannel:
    """Combine the laws of a link, assumed independent.

    Messages are sent at `source_rate_hz` over `distance_m`, with all vehicles `between` obstructing
    the line of sight. Without a distance the loss of a radio is unknown. Times in which a vehicle's
    radio is off do not count.
    """
    effects = link_effects(table, source_rate_hz, between=between)
    loss = expected_loss(table, effects, distance_m)
    mean, deviation = _delay(table, effects)
    ratio, burst = (None, None) if loss is None else (loss.loss, loss.burst)
    if burst == inf:
        burst = None
    return ExpectedChannel(
        loss_ratio=ratio,
        burst_messages=burst if ratio else None,
        latency_ms_mean=mean,
        latency_ms_deviation=deviation,
    )


def expected_loss(
    table: LinkTable, effects: Sequence[Effect], distance_m: float | None
) -> Losses | None:
    """Combine the losses of all laws: 1 - Π(1 - p); None if one is unknown."""
    if table.queue is not None:
        return None
    decimated = any(one.reason == "rate" for one in effects)
    if decimated and any(one.by_number for one in effects):
        return None  # the rate selects messages by number as well
    result = [one.losses(distance_m) for one in effects]
    if table.content is not None:
        result.append(table.content.corrupted(USUAL_MESSAGE_BYTES))
    known = [one for one in result if one is not None]
    if len(known) < len(result):
        return None
    lossy = [one for one in known if one.loss]
    loss = 0.0
    for one in lossy:
        loss += (1.0 - loss) * one.loss
    if decimated and any(one.has_memory for one in lossy):
        return Losses(loss)  # memory counts omitted messages too
    return Losses(loss, _burst(lossy, loss))


def _burst(lossy: Sequence[Losses], loss: float) -> float | None:
    """Return the mean burst of several independent stationary laws.

    The rate of ending bursts is P(passes) - P(two in a row pass), products over the laws.
    """
    together = [one.both_delivered for one in lossy]
    if not lossy or None in together:
        return None
    if len(lossy) == 1:
        return lossy[0].burst
    ends = (1.0 - loss) - prod(one for one in together if one is not None)
    return loss / ends if ends > _ROUNDING * loss else inf


def _delay(table: LinkTable, effects: Sequence[Effect]) -> tuple[float | None, float | None]:
    """Return mean and standard deviation (ms) of the sum of independent delays."""
    delays = [effect.delays for effect in effects]
    if link_stages(table) or None in delays:
        return None, None
    mean = sum(one.mean for one in delays if one)
    deviation = sqrt(sum(one.variance for one in delays if one))
    return mean / MILLISECOND, deviation / MILLISECOND
