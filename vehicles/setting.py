"""Annotation of a settings field: documentation, unit of its key, and allowed range.

A settings class is a frozen dataclass whose fields are annotated with a `Setting`. Its values are
in SI units; in a scenario file the key has the unit's suffix.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import degrees, radians

from vehicles.schedule import MILLISECOND, SECOND

QUALIFIERS = ("_max", "_min")
"""Suffixes of a name that follow the unit in its key: `probation_max` is `probation_s_max`."""
PER_SI = {"ms": 1000.0}  # Key units that are proportional to the SI unit, with the factor from SI
NANOSECONDS = {"s": SECOND, "ms": MILLISECOND}  # Per unit; integer fields are in ns
Problem = tuple[str, str]  # A key that contradicts others, and the reason


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: documentation, unit of its key, and bounds in that unit.

    `minimum` and `maximum` are inclusive, `above` is exclusive. `name` replaces the field's name in
    the key; `example` replaces a missing default. `kinds` maps the values of the key `kind` to the
    classes of a table or of a list's entries. Bounds of a list apply to its entries; `nonempty`
    requires at least one.
    """

    doc: str = ""
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    name: str = ""
    kinds: Mapping[str, type] | None = None
    nonempty: bool = False
    allow_infinite: bool = False
    example: object = None

    def key(self, field: str) -> str:
        """Key of `field` in a scenario file: its name with the unit, then any qualifier."""
        name = self.name or field
        if not self.unit:
            return name
        suffix = next((suffix for suffix in QUALIFIERS if name.endswith(suffix)), "")
        return f"{name.removesuffix(suffix)}_{self.unit}{suffix}"

    def to_si(self, value: float, *, whole: bool = False) -> float:
        """Convert from the key's unit to SI, or to nanoseconds for `whole` fields."""
        if whole and self.unit in NANOSECONDS:
            return round(value * NANOSECONDS[self.unit])
        if self.unit == "deg":
            return radians(value)
        return value / PER_SI[self.unit] if self.unit in PER_SI else value

    def from_si(self, value: float, *, whole: bool = False) -> float:
        """Inverse of `to_si`, rounded to 12 digits so that 0.1 stays 0.1."""
        if whole and self.unit in NANOSECONDS:
            return value / NANOSECONDS[self.unit]
        if self.unit == "deg":
            return float(f"{degrees(value):.12g}")
        return float(f"{value * PER_SI[self.unit]:.12g}") if self.unit in PER_SI else value


def must_exceed(key: str, value: float, bound: float, bound_name: str = "") -> Iterator[Problem]:
    """Report a value that does not exceed `bound`, which `bound_name` describes."""
    if value <= bound:
        suffix = f", {bound_name}" if bound_name else ""
        yield key, f"given {value:g}, allowed more than {bound:g}{suffix}"
