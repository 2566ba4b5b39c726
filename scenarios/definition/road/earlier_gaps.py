"""Gaps of scenarios in logs before version 0.2, which were between centres of mass."""

import tomllib
from typing import Any

import tomli_w

from vehicles.car.parameters import LINCOLN_MKZ

FORMER_DEFAULT = 15.0
"""Spacing (m) at the start where the scenario gave none."""


def with_bumper_gaps(text: str) -> str:
    """Subtract the length of a car from each gap of a scenario; invalid text is unchanged."""
    try:
        raw = tomllib.loads(text)
        _convert(raw)
    except (tomllib.TOMLDecodeError, AttributeError, TypeError):
        return text  # reported when it is read
    return tomli_w.dumps(raw)


def _convert(raw: dict[str, Any]) -> None:
    length = raw.get("parameters", {}).get("length_m", LINCOLN_MKZ.length)
    convoy, speed = raw.setdefault("convoy", {}), raw.get("speed", {})
    if speed.get("followers") != "gap":
        convoy.setdefault("gap_m", FORMER_DEFAULT)
    entries = [(convoy, "gap_m"), (speed.get("gap", {}), "standstill_m")]
    entries += [(vehicle, "gap_m") for vehicle in raw.get("vehicle", {}).values()]
    for table, key in entries:
        if key in table:
            table[key] = round(table[key] - length, 6)
