"""What a changed link does from when on: the course of its effects, from the changes about it."""

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
"""Keys of a link that a change may give another value."""

EffectsOf = Callable[[LinkTable, Sequence[Effect]], tuple[Effect, ...]]
"""Gives the effects of a link as asked for, with others besides."""


def links_of(
    change: LinkChange, names: Sequence[str], links: Iterable[tuple[str, str]]
) -> list[tuple[str, str]]:
    return [pair for pair in links if specificity(change, names, *pair) is not None]


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
"""The effects of one link by what can be changed of it: loss, latency, jitter, and whether cut."""


def course(
    changes: Sequence[tuple[int, LinkChange]],
    table: LinkTable,
    effects_of: EffectsOf,
    *,
    since: int = 0,
    made: Made | None = None,
) -> tuple[ChangedEffects, ...]:
    """Work out what a link that is asked for as `table` does from the instant `since` (ns) on.

    `changes` are those about it with their instants (ns), in order of time. A later one lies over
    an earlier one, key by key, and when it ends the earlier one holds again. A cut holds until it
    ends or is healed, whatever else is changed. Effects are taken from `made`, or put there.
    """
    made = {} if made is None else made
    spells = [_Spell.of(at, change) for at, change in changes]
    ends = {int(one.to_at) for one in spells if one.to_at < inf}
    found: list[ChangedEffects] = []
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
        asked, is_cut = _changed(table, active), any(one.is_cut for one in active)
        key = asked.loss_ratio, asked.latency_ms, asked.jitter_ms, is_cut
        if key not in made:
            made[key] = effects_of(asked, (Cut(),) if is_cut else ())
        found.append(ChangedEffects(at, made[key]))
    return tuple(found)


def _changed(table: LinkTable, active: Sequence[_Spell]) -> LinkTable:
    given = {
        key: value
        for one in active
        for key in QUALITIES
        if (value := getattr(one.change, key, None)) is not None
    }
    return table.model_copy(update=given)


def link_change_problems(tables: ScenarioTables) -> Iterator[tuple[str, str]]:
    """Give every key of a change of links that does not fit, and what is wrong with it."""
    for index, change in enumerate(tables.change):
        if isinstance(change, LINK_CHANGES):
            for key, why in link_change_errors(tables, change):
                yield f"change[{index}]{key}", why


def link_change_errors(tables: ScenarioTables, change: LinkChange) -> Iterator[tuple[str, str]]:
    """Give what does not fit of one change of links, under its key with a dot before it."""
    names = vehicle_names(tables)
    problems = list(end_problems(change, names))
    yield from problems
    if any(key for key, _ in problems) or not isinstance(change, LinkChangeTable):
        return
    if all(getattr(change, key) is None for key in QUALITIES):
        yield "", f"changes nothing, allowed at least one of {', '.join(QUALITIES)}"
    for sender, receiver in links_of(change, names, directed_links(names)):
        loss = requested_link(tables, names, sender, receiver).loss
        if loss is not None and loss.replaces_others:
            again = f"the link from {sender} to {receiver} repeats an earlier run"
            yield "", f'{again}, allowed kind = "cut" or "heal"'
            return
