"""One limit with its bound, as a scenario or the command line gives it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from typing import Any

from scenarios.definition.errors import ScenarioError
from scenarios.definition.refusal import near
from scenarios.definition.schema.limit_rows import LIMITS, WORDS, LimitRow, words_with_examples
from scenarios.definition.schema.limits import LimitsTable


@dataclass(frozen=True, slots=True)
class Limit:
    """A bound of the limit with this key, for one vehicle if it names one."""

    key: str
    bound: float
    vehicle: str = ""

    def __str__(self) -> str:
        """Write the limit as `--limit` takes it."""
        text = self.row.word if self.row.event else f"{self.row.word}={self.bound:g}"
        return f"{self.vehicle}.{text}" if self.vehicle else text

    @property
    def row(self) -> LimitRow:
        return LIMITS[self.key]

    @property
    def name(self) -> str:
        """Key inside of `[limits]`."""
        return f"{self.vehicle}.{self.key}" if self.vehicle else self.key

    @property
    def table(self) -> LimitsTable:
        """The table of a scenario with this limit alone."""
        bound = int(self.bound) if self.row.event else self.bound
        keys: dict[str, Any] = {self.key: bound}
        return LimitsTable.model_validate({self.vehicle: keys} if self.vehicle else keys)

    def is_beyond(self, figure: float) -> bool:
        """Whether a figure breaks the limit."""
        return self.excess(figure) > 0.0

    def excess(self, figure: float) -> float:
        """How far a figure is beyond the bound; negative while the limit holds."""
        return self.bound - figure if self.row.is_least else figure - self.bound


def limits_of(table: LimitsTable) -> Iterator[Limit]:
    """Yield the limits of a scenario in the order of their keys, that of the convoy first."""
    for key in LIMITS:
        for vehicle, bounds in (("", table), *table.of_vehicles.items()):
            bound = getattr(bounds, key)
            if bound is not None:
                yield Limit(key, bound, vehicle)


def parsed_limit(text: str, vehicles: Sequence[str]) -> Limit:
    """Read a limit of the command line, such as "lane" or "v5.error_m=0.5"; raises ScenarioError.

    `vehicles` are those of the scenario that a limit may name.
    """
    name, equals, number = text.partition("=")
    vehicle, dot, word = name.rpartition(".")
    row, bound = WORDS.get(word), _number(number)
    if row is not None and dot and (problem := problem_of(row, vehicle, vehicles)):
        raise ScenarioError([f"--limit: given {text!r}, {problem}"])
    if row is not None and row.event and not equals:
        return Limit(row.key, 0, vehicle)
    if row is not None and row.figure and isfinite(bound) and 0.0 <= bound <= row.most:
        return Limit(row.key, bound, vehicle)
    of_one = f"{vehicles[-1]}.error_m=0.5"
    allowed = f"{words_with_examples()}, or of one vehicle, such as {of_one}"
    raise ScenarioError([f"--limit: given {text!r}, allowed {allowed}"])


def problem_of(row: LimitRow, vehicle: str, vehicles: Sequence[str]) -> str:
    """Tell why a vehicle can have no limit of this row; empty if it can. The lead comes first."""
    if vehicle not in vehicles:
        return no_vehicle(vehicle, vehicles)
    if vehicle == vehicles[0] and not row.of_lead:
        followers = ", ".join(vehicles[1:]) or "there is none"
        return f"{vehicle} is the lead, allowed a follower: {followers}"
    return ""


def no_vehicle(name: str, vehicles: Sequence[str]) -> str:
    """Report an unknown name of a vehicle, with the known ones."""
    return "no such vehicle" + (near(name, vehicles) or f", allowed {', '.join(vehicles)}")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return nan
