"""Units at the end of keys and of values such as "20ms"."""

import re
from math import pi

UNITS = {
    "s": ("s", 1.0), "ms": ("s", 1e-3), "us": ("s", 1e-6), "min": ("s", 60.0), "h": ("s", 3600.0),
    "m": ("m", 1.0), "km": ("m", 1000.0), "cm": ("m", 0.01), "mm": ("m", 1e-3),
    "mps": ("mps", 1.0), "kmh": ("mps", 1 / 3.6), "kph": ("mps", 1 / 3.6), "mph": ("mps", 0.44704),
    "ratio": ("ratio", 1.0), "percent": ("ratio", 0.01), "pct": ("ratio", 0.01),
    "hz": ("hz", 1.0), "khz": ("hz", 1000.0),
    "rad": ("rad", 1.0), "deg": ("rad", pi / 180.0),
    "mps2": ("mps2", 1.0), "mps3": ("mps3", 1.0), "kg": ("kg", 1.0), "t": ("kg", 1000.0),
}  # fmt: skip
"""Quantity of a unit, and its factor to the SI unit."""
_SPELLINGS = {"%": "percent", "km/h": "kmh", "m/s": "mps", "m/s2": "mps2", "m/s²": "mps2"}
_NUMBER = re.compile(r"([-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*(\S*)")
_QUALIFIERS = ("_max", "_min")


def split_key(key: str) -> tuple[str, str]:
    """Split a key into its stem with the qualifier, and its unit: `error_m_max` is `error_max`."""
    ending = next((word for word in _QUALIFIERS if key.endswith(word)), "")
    stem, _, unit = key.removesuffix(ending).rpartition("_")
    return (f"{stem}{ending}", unit) if stem and unit in UNITS else (key, "")


def converted(value: float, unit: str, wanted: str) -> float | None:
    """Convert a value between units of one quantity, rounded to 6 digits; None between others."""
    if unit == wanted:
        return value
    if unit not in UNITS or wanted not in UNITS or UNITS[unit][0] != UNITS[wanted][0]:
        return None
    return float(f"{value * UNITS[unit][1] / UNITS[wanted][1]:.6g}")


def number_in(text: str, wanted: str) -> float | None:
    """Read a text such as "20ms", "40 %" or "0,4" as a number in the `wanted` unit."""
    match = _NUMBER.fullmatch(text.strip().lstrip("=").strip())
    if match is None:
        return None
    unit = _SPELLINGS.get(match[2].lower(), match[2].lower()) or wanted
    return converted(float(match[1].replace(",", ".")), unit, wanted)
