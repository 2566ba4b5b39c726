"""Changes that contradict the vehicles, the length of the run, or one another."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Any

from pydantic import ValidationError

from scenarios.definition.channel.build import end_problems, requested_link, specificity
from scenarios.definition.errors import Problem, ScenarioError
from scenarios.definition.problem_lines import error_lines
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.change_tables import (
    LATEST_S,
    AnyChange,
    Changes,
    CrashTable,
    CutTable,
    FixChangeTable,
    HealTable,
    JoinTable,
    LeaveTable,
    LinkChangeTable,
    SpeedChangeTable,
    StallTable,
    VehicleChangeTable,
)
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.schema.settings_table import Table
from scenarios.definition.topology import directed_links
from scenarios.definition.wording import toml_repr
from transport.links.laws.basic import Cut
from transport.links.laws.link_law import Effect
from transport.links.link import ChangedEffects
from vehicles.schedule import nanoseconds

CLOCK_MS_MAX = 10_000.0
"""Largest error of a vehicle's clock; receivers refuse poses with a larger one."""

VEHICLE_CHANGES = frozenset({"gnss", "stall", "crash", "leave", "join"})
"""Kinds of changes of a vehicle."""


def joins_late(changes: Iterable[AnyChange], name: str) -> bool:
    parts = [one for one in _of(changes, name) if isinstance(one, JoinTable | LeaveTable)]
    return bool(parts) and isinstance(min(parts, key=lambda one: one.at_s), JoinTable)


def is_changed(changes: Iterable[AnyChange], name: str) -> bool:
    return bool(_of(changes, name))


def vehicle_change_problems(tables: ScenarioTables, duration_s: float) -> Iterator[Problem]:
    """Yield impossible changes, and clocks with too large an error."""
    names = vehicle_names(tables)
    for index, change in enumerate(tables.change):
        key = f"change[{index}]"
        if change.at_s >= duration_s:
            yield (
                f"{key}.at_s",
                f"given {change.at_s:g}, allowed less than the run's {duration_s:g}",
            )
        if isinstance(change, VehicleChangeTable):
            yield from _about_one(tables, names, key, change)
    for name in names:
        yield from _in_order(tables.change, name)
        yield from _clock(tables, name, duration_s)


def _of(changes: Iterable[AnyChange], name: str) -> list[VehicleChangeTable]:
    return [one for one in changes if isinstance(one, VehicleChangeTable) and one.vehicle == name]


def _about_one(
    tables: ScenarioTables, names: Sequence[str], key: str, change: VehicleChangeTable
) -> Iterator[Problem]:
    name = change.vehicle
    if name not in names:
        yield f"{key}.vehicle", f"given {toml_repr(name)}, allowed {', '.join(names)}"
        return
    if name in tables.repeats_messages:
        yield (
            f"{key}.vehicle",
            f"given {toml_repr(name)}, which sends recorded messages, allowed a simulated vehicle",
        )
        return
    own = tables.vehicle.get(name)
    if name == names[0] and isinstance(change, JoinTable | LeaveTable):
        yield (
            f"{key}.vehicle",
            f"given the lead, which cannot {change.kind} the convoy, allowed a follower",
        )
    elif own and own.replay is not None and not isinstance(change, FixChangeTable):
        yield (
            f"{key}.vehicle",
            f'given {toml_repr(name)}, which replays a drive, allowed only kind = "gnss"',
        )


def _in_order(changes: Sequence[AnyChange], name: str) -> Iterator[Problem]:
    order = sorted(
        (one.at_s, index, one)
        for index, one in enumerate(changes)
        if isinstance(one, VehicleChangeTable) and one.vehicle == name
    )
    away = "it has not joined yet" if joins_late(changes, name) else ""
    busy_until, busy = -inf, ""
    for at_s, index, change in order:
        key = f"change[{index}]"
        if isinstance(change, FixChangeTable):
            continue
        if isinstance(change, JoinTable):
            if not away:
                yield key, f"{name} joins at {at_s:g} s, but is in the convoy by then"
            away = ""
            continue
        if away:
            yield key, f"{name}: {change.kind} at {at_s:g} s, but {away}"
        elif at_s < busy_until:
            yield key, f"{name}: {change.kind} at {at_s:g} s, but {busy} until {busy_until:g} s"
        if isinstance(change, LeaveTable):
            away = f"it has left at {at_s:g} s"
        elif isinstance(change, StallTable | CrashTable):
            busy_until = at_s + (inf if change.for_s is None else change.for_s)
            busy = "it stalls" if isinstance(change, StallTable) else "it is down"


def _clock(tables: ScenarioTables, name: str, duration_s: float) -> Iterator[Problem]:
    own = tables.vehicle.get(name)
    if own is None:
        return
    end_ms = own.clock.offset_ms + own.clock.drift_ppm * duration_s / 1000.0
    if abs(end_ms) > CLOCK_MS_MAX:
        yield (
            f"vehicle.{name}.clock.drift_ppm",
            f"given {own.clock.drift_ppm:g}, an error of {end_ms:.0f} ms at the end of the run, "
            f"allowed at most {CLOCK_MS_MAX:g}",
        )


# ---- Changes of links: the links concerned, and the effects of a link over time


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


# ---- A change requested during a run, as JSON


MOST_BYTES = 4096
"""Longest request."""
_HERE = "change[0]"
_NOT_DESCRIBED = {"at_s", "kind", "sender", "receiver", "vehicle", "for_s"}


class _Asked(Table):
    """One change as in a scenario, for the same error lines."""

    change: Changes


def change_json(change: AnyChange) -> str:
    return json.dumps(change.model_dump(exclude_unset=True, exclude_none=True))


def describe_change(change: AnyChange) -> str:
    if isinstance(change, HealTable):
        return "as in the scenario"
    values = change.model_dump(exclude_none=True, exclude=_NOT_DESCRIBED)
    pairs = ", ".join(f"{key} {value}" for key, value in values.items())
    for_s = getattr(change, "for_s", None)
    duration = f"for {for_s:g} s" if for_s is not None else ""
    kind = "" if isinstance(change, LinkChangeTable) else change.kind
    return " ".join(filter(None, (kind, pairs, duration)))


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """A request to a vehicle: a change as an entry without `at_s`, or an empty entry.

    `at_s` is the instant at which several vehicles make the change together (s after the start). A
    vehicle promises a change and makes it once a request with the same `at_s` `confirms` it.
    """

    entry: dict[str, Any] = field(default_factory=dict)
    at_s: float | None = None
    confirms: bool = False

    @property
    def text(self) -> bytes:
        wanted = {} if self.at_s is None else {"at_s": self.at_s}
        return json.dumps({**self.entry, **wanted, "confirms": self.confirms}).encode()

    @classmethod
    def of(cls, text: bytes) -> "ChangeRequest":
        if len(text) > MOST_BYTES:
            raise ScenarioError([f"given {len(text)} bytes, allowed {MOST_BYTES}"])
        try:
            entry = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ScenarioError([f"no JSON: {error}"]) from error
        if not isinstance(entry, dict):
            raise ScenarioError(["allowed one entry of [[change]], as JSON"])
        at_s, confirms = entry.pop("at_s", None), entry.pop("confirms", False)
        wanted = isinstance(at_s, int | float) and 0.0 <= at_s <= LATEST_S
        return cls(entry, float(at_s) if wanted else None, confirms is True)


def read_change(
    entry: dict[str, Any], at_s: float, tables: ScenarioTables, duration_s: float
) -> AnyChange:
    """Validate a change that takes effect `at_s` after the start of a run.

    `tables` hold the other changes of the run. Raises ScenarioError with a line for each problem.
    """
    change = _validated({**entry, "at_s": at_s})
    if problems := list(change_errors(tables, change, duration_s)):
        raise ScenarioError(_line(key, why) for key, why in problems)
    return change


def change_from_json(entry: str) -> AnyChange:
    try:
        return _validated(json.loads(entry))
    except (ValueError, RecursionError) as error:
        raise ScenarioError([f"no JSON: {error}"]) from error


def changed_links(
    entry: str, names: Sequence[str], links: Iterable[tuple[str, str]]
) -> list[tuple[str, str]]:
    try:
        change = change_from_json(entry)
    except ScenarioError:  # of a later version
        return []
    return links_of(change, names, links) if isinstance(change, LINK_CHANGES) else []


def _validated(entry: object) -> AnyChange:
    try:
        return _Asked.model_validate({"change": [entry]}).change[0]
    except ValidationError as error:
        raise ScenarioError(_line(key, why) for key, why in error_lines(error)) from error


def change_errors(
    tables: ScenarioTables, change: AnyChange, duration_s: float
) -> Iterator[tuple[str, str]]:
    """Yield the problems of an additional change, with its keys as those of `change[0]`."""
    if isinstance(change, LINK_CHANGES):
        for key, why in link_change_errors(tables, change):
            yield f"{_HERE}{key}", why
        return
    changed = tables.model_copy(update={"change": (change, *tables.change)})
    yield from vehicle_change_problems(changed, duration_s)


def _line(key: str, why: str) -> str:
    own = key.removeprefix(_HERE).removeprefix(".")
    return f"{own}: {why}" if own else why
