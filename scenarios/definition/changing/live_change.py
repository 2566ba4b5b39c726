"""A change requested during a run, as JSON."""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import ValidationError

from scenarios.definition.changing.link_changes import LINK_CHANGES, link_change_errors, links_of
from scenarios.definition.changing.vehicle_changes import vehicle_change_problems
from scenarios.definition.errors import ScenarioError
from scenarios.definition.schema.base_table import Table
from scenarios.definition.schema.change_tables import (
    LATEST_S,
    AnyChange,
    Changes,
    HealTable,
    LinkChangeTable,
)
from scenarios.definition.schema.scenario_tables import ScenarioTables
from scenarios.definition.validation.problem_lines import error_lines

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
