"""Changes that contradict the vehicles, the length of the run, or one another."""

from collections.abc import Iterable, Iterator, Sequence
from math import inf

from scenarios.definition.errors import Problem
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.change_tables import (
    AnyChange,
    CrashTable,
    FixChangeTable,
    JoinTable,
    LeaveTable,
    StallTable,
    VehicleChangeTable,
)
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.validation.wording import toml_repr

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
