"""Changes of links: the links concerned, and the effects of a link over time."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import inf

from scenarios.definition.channel.rules import end_problems, requested_link, specificity
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.change_tables import (
    AnyChange,
    CutTable,
    HealTable,
    LinkChangeTable,
    SpeedChangeTable,
)
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.topology import directed_links
from transport.links.laws.basic import Cut
from transport.links.laws.effect import Effect
from transport.links.link import ChangedEffects
from vehicles.schedule import nanoseconds

LinkChange = LinkChangeTable | CutTable | HealTable
LINK_CHANGES = LinkChangeTable, CutTable, HealTable
QUALITIES = ("loss_ratio", "latency_ms", "jitter_ms")
"""Keys of a link that a change can set."""

EffectsOf = Callable[[LinkTable, Sequence[Effect]], tuple[Effect, ...]]
"""Builds the effects of a link from its settings, with additional effects."""


def links_of(
    change: LinkChange, names: Sequence[str], links: Iterable[tuple[str, str]]
) -> list[tuple[str, str]]:
    return [pair for pair in links if specificity(change, names, *pair) is not None]


def concerns(
    change: AnyChange, vehicle: str, tables: ScenarioTables, links: Iterable[tuple[str, str]]
) -> bool:
    """Whether `vehicle` makes a change: the receiver of a link, or a vehicle with the set speed."""
    if vehicle in tables.repeats_messages:
        return False
    names = vehicle_names(tables)
    if isinstance(change, LINK_CHANGES):
        return any(receiver == vehicle for _, receiver in links_of(change, names, links))
    if isinstance(change, SpeedChangeTable):
        return vehicle == names[0] or tables.speed.followers == "same"
    return vehicle == change.vehicle


@dataclass(frozen=True, slots=True)
class _Spell:
    change: LinkChange
    from_at: int
    to_at: float

    @classmethod
    def of(cls, at: int, change: LinkChange) -> "_Spell":
        for_s = None if isinstance(change, HealTable) else change.for_s
        return cls(change, at, inf if for_s is None else at + nanoseconds(for_s))

    @property
    def is_cut(self) -> bool:
        return isinstance(self.change, CutTable)


Made = dict[tuple[float, float, float, bool], tuple[Effect, ...]]
"""Cache of the effects of one link by loss, latency, jitter, and whether it is cut."""


def course(
    changes: Sequence[tuple[int, LinkChange]],
    table: LinkTable,
    effects_of: EffectsOf,
    *,
    since: int = 0,
    made: Made | None = None,
) -> tuple[ChangedEffects, ...]:
    """Return the effects of a link with settings `table` from the instant `since` (ns) on.

    `changes` of the link have instants (ns) and are in order of time. A later change replaces keys
    of earlier ones until it ends. A cut lasts until it ends or is healed. `made` is a cache.
    """
    made = {} if made is None else made
    spells = [_Spell.of(at, change) for at, change in changes]
    ends = {int(one.to_at) for one in spells if one.to_at < inf}
    effects: list[ChangedEffects] = []
    active: list[_Spell] = []
    coming = iter([*spells, None])
    following = next(coming)
    for at in sorted({one.from_at for one in spells} | ends):
        while following is not None and following.from_at <= at:
            active = [] if isinstance(following.change, HealTable) else [*active, following]
            following = next(coming)
        active = [one for one in active if at < one.to_at]
        if at < since:
            continue
        link, is_cut = _changed(table, active), any(spell.is_cut for spell in active)
        key = link.loss_ratio, link.latency_ms, link.jitter_ms, is_cut
        if key not in made:
            made[key] = effects_of(link, (Cut(),) if is_cut else ())
        effects.append(ChangedEffects(at, made[key]))
    return tuple(effects)


def _changed(table: LinkTable, active: Sequence[_Spell]) -> LinkTable:
    given = {
        key: value
        for one in active
        for key in QUALITIES
        if (value := getattr(one.change, key, None)) is not None
    }
    return table.model_copy(update=given)


def link_change_problems(tables: ScenarioTables) -> Iterator[tuple[str, str]]:
    """Yield the problems of all link changes by key."""
    for index, change in enumerate(tables.change):
        if isinstance(change, LINK_CHANGES):
            for key, why in link_change_errors(tables, change):
                yield f"change[{index}]{key}", why


def link_change_errors(tables: ScenarioTables, change: LinkChange) -> Iterator[tuple[str, str]]:
    """Yield the problems of one link change, by keys that begin with a dot."""
    names = vehicle_names(tables)
    problems = list(end_problems(change, tables))
    yield from problems
    if any(key for key, _ in problems) or not isinstance(change, LinkChangeTable):
        return
    if all(getattr(change, key) is None for key in QUALITIES):
        yield "", f"changes nothing, allowed at least one of {', '.join(QUALITIES)}"
    for sender, receiver in links_of(change, names, directed_links(tables)):
        loss = requested_link(tables, names, sender, receiver).loss
        if loss is not None and loss.replaces_others:
            again = f"the link from {sender} to {receiver} repeats an earlier run"
            yield "", f'{again}, allowed kind = "cut" or "heal"'
            return
