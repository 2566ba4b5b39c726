"""The limits of a run, from a scenario or the command line, checked against the convoy."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from scenarios.definition.errors import Problem, ScenarioError
from scenarios.definition.road.route import vehicle_names
from scenarios.definition.schema.limit_rows import (
    LIMITS,
    OWN_FIGURES,
    WORDS,
    LimitRow,
    own_row,
    row_of,
    words_with_examples,
)
from scenarios.definition.schema.limit_tables import (
    DEADLINES,
    DeadlineTable,
    LimitsTable,
    ModeLimit,
    SourceLimit,
)
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.topology import information_flow
from scenarios.definition.wording import did_you_mean, either, toml_repr

SLACK_S = 1e-9
SIDES = ("_max", "_min")
"""Ends of the bounds on figures of the user's classes."""
OF_SOURCES = {"composite", "lead", "predecessor", "intermediate"}
"""Modes of a follower that steers along its sources; which ones depends on its information flow."""


@dataclass(frozen=True, slots=True)
class Limit:
    """The bound of a limit, for the convoy or for one vehicle; `key` is that of [limits]."""

    key: str
    bound: float
    vehicle: str = ""

    def __str__(self) -> str:
        text = self.row.word if self.row.event else f"{self.row.word}={self.bound:g}"
        return f"{self.vehicle}.{text}" if self.vehicle else text

    @property
    def row(self) -> LimitRow:
        return row_of(self.key) or LIMITS[self.key]

    @property
    def name(self) -> str:
        return f"{self.vehicle}.{self.key}" if self.vehicle else self.key

    @property
    def table(self) -> LimitsTable:
        bound = int(self.bound) if self.row.event else self.bound
        keys: dict[str, Any] = {self.key: bound}
        if self.row.own_figure:
            keys = {OWN_FIGURES: {self.row.word: bound}}
        return LimitsTable.model_validate({self.vehicle: keys} if self.vehicle else keys)

    def is_beyond(self, figure: float) -> bool:
        return figure < self.bound if self.row.is_least else figure > self.bound


def limits_of(table: LimitsTable) -> Iterator[Limit]:
    """Yield limits in the order of their keys, the convoy's before those of vehicles."""
    for key in LIMITS:
        for vehicle, bounds in (("", table), *table.of_vehicles.items()):
            bound = getattr(bounds, key)
            if bound is not None:
                yield Limit(key, bound, vehicle)
    for vehicle, bounds in (("", table), *table.of_vehicles.items()):
        for name, bound in (bounds.own_figures or {}).items():
            yield Limit(own_row(name).key, bound, vehicle)


def parsed_limit(text: str, vehicles: Sequence[str], own_figures: Sequence[str] = ()) -> Limit:
    """Parse a limit of the command line, such as "lane" or "v5.error_m=0.5"; raises ScenarioError.

    `vehicles` are the names that a limit may have; `own_figures` those of the user's figures.
    """
    name, equals, number = text.partition("=")
    vehicle, dot, word = name.rpartition(".")
    row, bound = _row_of(word, own_figures), _number(number)
    if row is not None and dot and (problem := problem_of(row, vehicle, vehicles)):
        raise ScenarioError([f"--limit: given {text!r}, {problem}"])
    if row is not None and row.event and not equals:
        return Limit(row.key, 0, vehicle)
    if row is not None and not row.event and isfinite(bound) and row.least <= bound <= row.most:
        return Limit(row.key, bound, vehicle)
    hint = f", did you mean {vehicle}{dot}{row.word}?" if row is not None and row.event else ""
    of_one = f"{vehicles[-1]}.error_m=0.5"
    own = "".join([f", {figure}_max=1" for figure in own_figures])
    allowed = f"{words_with_examples()}{own}, or of one vehicle, such as {of_one}"
    raise ScenarioError([f"--limit: given {text!r}, allowed {allowed}{hint}"])


def problem_of(row: LimitRow, vehicle: str, vehicles: Sequence[str]) -> str:
    """Return why a vehicle cannot have a limit, or an empty text; the lead is the first vehicle."""
    if vehicle not in vehicles:
        return no_vehicle(vehicle, vehicles)
    if vehicle == vehicles[0] and not row.of_lead:
        followers = ", ".join(vehicles[1:]) or "there is none"
        return f"{vehicle} is the lead, allowed a follower: {followers}"
    return ""


def no_vehicle(name: str, vehicles: Sequence[str]) -> str:
    return "no such vehicle" + (did_you_mean(name, vehicles) or f", allowed {', '.join(vehicles)}")


def _row_of(word: str, own_figures: Sequence[str]) -> LimitRow | None:
    """Return the limit of a word, of a key of `[limits]`, or on one of the user's figures."""
    is_own = word.endswith(SIDES) and word.rpartition("_")[0] in own_figures
    return own_row(word) if is_own else WORDS.get(word) or LIMITS.get(word)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan


def limit_problems(tables: ScenarioTables, duration_s: float) -> Iterator[Problem]:
    """Yield limits of unknown vehicles, invalid ones of the lead, and deadlines after the end."""
    limits, names = tables.limits, vehicle_names(tables)
    for name, own in limits.of_vehicles.items():
        if name not in names:
            yield f"limits.{name}", no_vehicle(name, names)
            continue
        for key in own.model_fields_set & LIMITS.keys():
            if problem := problem_of(LIMITS[key], name, names):
                yield f"limits.{name}.{key}", problem
    yield from _about_own_figures(tables)
    for name in DEADLINES:
        for index, limit in enumerate(getattr(limits, name)):
            key = f"limits.{name}[{index}]"
            yield from _about(tables, key, limit)
            if limit.after_s + limit.within_s > duration_s + SLACK_S:
                yield (
                    f"{key}.within_s",
                    f"given {limit.within_s:g} after {limit.after_s:g} s, allowed together at most "
                    f"the run's {duration_s:g}",
                )


def _about_own_figures(tables: ScenarioTables) -> Iterator[Problem]:
    """Yield bounds on figures that are not in [[figure]]."""
    known = [table.word for table in tables.figure]
    allowed = [f"{figure}{side}" for figure in known for side in SIDES]
    for vehicle, bounds in (("", tables.limits), *tables.limits.of_vehicles.items()):
        for name in bounds.own_figures or ():
            if name not in allowed:
                key = ".".join(filter(None, ("limits", vehicle, OWN_FIGURES, name)))
                hint = did_you_mean(name, allowed) or (
                    f", allowed {', '.join(allowed) or 'one of [[figure]]; there is none'}"
                )
                yield key, f"no such figure{hint}"


def _about(tables: ScenarioTables, key: str, limit: DeadlineTable) -> Iterator[Problem]:
    names = vehicle_names(tables)
    if limit.vehicle not in names[1:]:
        allowed = f"allowed a follower: {', '.join(names[1:]) or 'there is none'}"
        yield f"{key}.vehicle", f"given {toml_repr(limit.vehicle)}, {allowed}"
        return
    if limit.vehicle in tables.replayed:
        yield (
            f"{key}.vehicle",
            f"given {toml_repr(limit.vehicle)}, which is replayed and receives nothing",
        )
    flow = information_flow(tables, limit.vehicle)
    if isinstance(limit, ModeLimit) and limit.mode in OF_SOURCES:
        modes = _modes_along(names, limit.vehicle, flow.lateral)
        if limit.mode not in modes:
            yield (
                f"{key}.mode",
                f"given {toml_repr(limit.mode)}, but {limit.vehicle} steers along "
                f"{', '.join(flow.lateral)} only, allowed "
                f"{either([*modes, 'coast', 'stop', 'straight'])}",
            )
    if isinstance(limit, SourceLimit):
        yield from _source(flow.received(names), key, limit)


def _modes_along(names: Sequence[str], vehicle: str, lateral: Sequence[str]) -> list[str]:
    """Return the modes in which a follower steers along its lateral sources."""
    words = {names[names.index(vehicle) - 1]: "predecessor", names[0]: "lead"}
    alone = dict.fromkeys(words.get(name, "intermediate") for name in lateral)
    return ["composite", *alone] if len(lateral) > 1 else [*alone]


def _source(sources: Sequence[str], key: str, limit: SourceLimit) -> Iterator[Problem]:
    if limit.source not in sources:
        yield (
            f"{key}.source",
            f"given {toml_repr(limit.source)}, {limit.vehicle} does not receive from it, allowed "
            f"{' or '.join(sources)}",
        )
