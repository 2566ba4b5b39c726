"""Figures of a summary by name: of the worst follower, a vehicle, or a link."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from difflib import get_close_matches
from math import isfinite
from types import NoneType
from typing import Any, get_args

from scenarios.definition.errors import ScenarioError
from scenarios.definition.schema.limit_rows import OWN_FIGURES
from scenarios.definition.topology import usual_links
from scenarios.results.channel.link_summary import SAFE_AGES_MS, LinkSummary
from scenarios.results.events.encounters import EventKind
from scenarios.results.summary import RunSummary
from scenarios.results.vehicles.vehicle_figures import VehicleSummary
from transport.reasons import DropReason
from vehicles.messages import Mode

SUBFIELDS: Mapping[str, Sequence[str]] = {
    "ticks_by_mode": get_args(Mode),
    "dropped": get_args(DropReason),
    "safe_time_ratio": tuple(map(str, SAFE_AGES_MS)),
}
"""Fields that are tables, with their possible keys."""
RUN_FIELDS = ("ran_s",)
MAX_SUGGESTIONS = 4


@dataclass(frozen=True, slots=True)
class SweepFigure:
    """A figure of a summary by its name.

    `FIELD` is the value of the worst follower: the largest, or for `*_min` and `safe_time_ratio`
    the smallest. `v3.FIELD` is the value of one vehicle, `links.FIELD` of the worst link,
    `v1:v2.FIELD` of one link. `events.KIND` is a count. Dots separate nested fields.
    `own_figures.NAME`, a figure of the user's class, is the largest of all vehicles.
    """

    name: str

    @property
    def is_worst_when_least(self) -> bool:
        return self.name.endswith("_min") or "safe_time_ratio" in self.name.split(".")

    @property
    def is_gain(self) -> bool:
        return "_gain_" in self.name or "_growth_" in self.name

    def of(self, summary: RunSummary) -> float | None:
        """The value in a run, or None if nothing was measured."""
        scope, _, rest = self.name.partition(".")
        if scope == "events":
            return float(sum(event.kind == rest for event in summary.events))
        if self.name in RUN_FIELDS:
            return float(getattr(summary, self.name))
        rows, path = self._rows(summary, scope, rest)
        values = [_value(row, path.split(".")) for row in rows]
        known = [float(value) for value in values if value is not None and isfinite(value)]
        if not known:
            return None
        return min(known) if self.is_worst_when_least else max(known)

    def _rows(self, summary: RunSummary, scope: str, rest: str) -> tuple[Iterable[Any], str]:
        if scope == "links":
            return summary.links, rest
        if ":" in scope:
            ends = tuple(scope.split(":"))
            return [row for row in summary.links if (row.sender, row.receiver) == ends], rest
        if scope == OWN_FIGURES:
            return summary.vehicles, self.name
        if scope in VEHICLE_FIELD_HEADS:
            return [row for row in summary.vehicles if row.role == "follower"], self.name
        return [row for row in summary.vehicles if row.name == scope], rest


def _value(row: Any, path: Sequence[str]) -> float | None:
    for part in path:
        if isinstance(row, Mapping):
            # A missing count is 0; a share without commands and a figure that failed are unknown.
            row = row.get(part, None if path[0] in {"safe_time_ratio", OWN_FIGURES} else 0)
        else:
            row = getattr(row, part)
    return None if row is None else float(row)


def _paths(kind: type) -> Iterator[str]:
    """Yield the dotted names of all numbers of a summary class."""
    for one in fields(kind):
        types = set(get_args(one.type) or (one.type,)) - {NoneType}
        if types <= {int, float}:
            yield one.name
        elif one.name in SUBFIELDS:
            yield from (f"{one.name}.{word}" for word in SUBFIELDS[one.name])
        elif isinstance(one.type, type) and is_dataclass(one.type):
            yield from (f"{one.name}.{path}" for path in _paths(one.type))


VEHICLE_FIELDS = tuple(_paths(VehicleSummary))
LINK_FIELDS = tuple(_paths(LinkSummary))
VEHICLE_FIELD_HEADS = frozenset(path.split(".")[0] for path in VEHICLE_FIELDS)


def parsed_figure(
    text: str,
    vehicles: Sequence[str],
    own_figures: Sequence[str] = (),
    pairs: Iterable[tuple[str, str]] = (),
) -> SweepFigure:
    """Parse the name of a figure; raises ScenarioError with similar names.

    `own_figures` are the names of those of the user's classes, `pairs` the links, by default those
    of the usual information flow.
    """
    own = [f"{OWN_FIGURES}.{name}" for name in own_figures]
    ends = pairs or usual_links(vehicles)
    links = ("links", *(f"{sender}:{receiver}" for sender, receiver in ends))
    scope, dot, _ = text.partition(".")
    if scope in vehicles and dot:
        known = [f"{scope}.{path}" for path in (*VEHICLE_FIELDS, *own)]
    elif scope in links and dot:
        known = [f"{scope}.{path}" for path in LINK_FIELDS]
    else:
        known = [
            *VEHICLE_FIELDS,
            *own,
            *RUN_FIELDS,
            *(f"events.{kind}" for kind in get_args(EventKind)),
        ]
        known += [f"links.{path}" for path in LINK_FIELDS]
    if text in known:
        return SweepFigure(text)
    near = _near(text, known)
    hint = f"similar: {', '.join(near)}" if near else "see `convoy reference fields`"
    raise ScenarioError([f"--metric: unknown metric {text!r}, {hint}"])


def _near(text: str, known: Sequence[str]) -> list[str]:
    inside = [name for name in known if len(text) > 2 and text in name]
    return list(dict.fromkeys([*get_close_matches(text, known, n=MAX_SUGGESTIONS), *inside]))[
        :MAX_SUGGESTIONS
    ]
