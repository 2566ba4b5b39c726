"""Labels with units for keys of a scenario and for fields of the summary."""

import re
from dataclasses import dataclass

UNITS = {
    "m": "m",
    "s": "s",
    "ms": "ms",
    "ns": "ns",
    "hz": "Hz",
    "mps": "m/s",
    "mps2": "m/s²",
    "mps3": "m/s³",
    "rad": "rad",
    "radps": "rad/s",
    "deg": "°",
    "per_m": "1/m",
    "per_s": "1/s",
    "kg": "kg",
    "db": "dB",
    "ppm": "ppm",
    "bytes": "bytes",
    "ratio": "%",
}
PERCENT = 100.0
QUALIFIERS = {
    "max": "largest ",
    "min": "smallest ",
    "mean": "mean ",
    "rms": "rms ",
    "p95": "95th percentile of ",
}
PLACES = {"links": " of all links", "convoy": "", "events": " events"}
"""Words for the first part of a name; other parts are put in brackets."""
_NAME = re.compile(
    rf"(?P<name>\w+?)_(?P<unit>{'|'.join(UNITS)})(?:_(?P<qualifier>{'|'.join(QUALIFIERS)}))?"
)


@dataclass(frozen=True, slots=True)
class AxisLabel:
    """Text of an axis, and the factor by which values are multiplied on it (100 for ratios)."""

    text: str
    factor: float = 1.0


def axis_label(name: str) -> AxisLabel:
    """Label of a key such as `links.loss_ratio` or a field such as `cross_track_error_m_max`."""
    place, _, last = name.rpartition(".")
    where = PLACES.get(place, f" ({place})" if place else "")
    match = _NAME.fullmatch(last)
    if match is None:
        return AxisLabel(f"{_words(last)}{where}")
    qualifier = QUALIFIERS.get(match["qualifier"] or "", "")
    factor = PERCENT if match["unit"] == "ratio" else 1.0
    return AxisLabel(f"{qualifier}{_words(match['name'])}{where}, {UNITS[match['unit']]}", factor)


def _words(name: str) -> str:
    return name.replace("cross_track", "cross-track").replace("_", " ")
