"""A change that is asked for by hand, as JSON: read, or refused in a line."""

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
"""Of a question."""
_HERE = "change[0]"
_NOT_TOLD = {"at_s", "kind", "sender", "receiver", "vehicle", "for_s"}


class _Asked(Table):
    """One change, in its place in a scenario, so that it is refused in the same words."""

    change: Changes


def change_json(change: AnyChange) -> str:
    return json.dumps(change.model_dump(exclude_unset=True, exclude_none=True))


def describe_change(change: AnyChange) -> str:
    if isinstance(change, HealTable):
        return "as the scenario has it again"
    told = change.model_dump(exclude_none=True, exclude=_NOT_TOLD)
    values = ", ".join(f"{key} {value}" for key, value in told.items())
    for_s = getattr(change, "for_s", None)
    how_long = f"for {for_s:g} s" if for_s is not None else ""
    what = "" if isinstance(change, LinkChangeTable) else change.kind
    return " ".join(filter(None, (what, values, how_long)))


@dataclass(frozen=True, slots=True)
class ChangeRequest:
    """What is asked of a vehicle: a change as an entry without `at_s`, or nothing but when.

    `at_s` is when it is wanted, so that several vehicles do it at one instant; each is free to do
    it later, and says so.
    """

    entry: dict[str, Any] = field(default_factory=dict)
    at_s: float | None = None

    @property
    def text(self) -> bytes:
        wanted = {} if self.at_s is None else {"at_s": self.at_s}
        return json.dumps({**self.entry, **wanted}).encode()

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
        at_s = entry.pop("at_s", None)
        wanted = isinstance(at_s, int | float) and 0.0 <= at_s <= LATEST_S
        return cls(entry, float(at_s) if wanted else None)


def read_change(
    entry: dict[str, Any], at_s: float, tables: ScenarioTables, duration_s: float
) -> AnyChange:
    """The change that is asked of a convoy of `tables`, to take effect `at_s` after the start.

    The tables have all that is done to it besides. Raises ScenarioError with a line for each thing
    that is wrong.
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
    """Give what does not fit of one more change, under its key in a list of its own."""
    if isinstance(change, LINK_CHANGES):
        for key, why in link_change_errors(tables, change):
            yield f"{_HERE}{key}", why
        return
    changed = tables.model_copy(update={"change": (change, *tables.change)})
    yield from vehicle_change_problems(changed, duration_s)


def _line(key: str, why: str) -> str:
    own = key.removeprefix(_HERE).removeprefix(".")
    return f"{own}: {why}" if own else why
