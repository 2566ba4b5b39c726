"""Units of tables: their names, and values in other units and forms."""

import math
import re
from typing import Final

ANGLES: Final = {"deg": 1.0, "rad": 57.29577951308232, "e7": 1e-7, "semicircles": 180 / 2**31}
LENGTHS: Final = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
SPEEDS: Final = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600, "mm/s": 1e-3}
TIMES: Final = ("s", "ms", "us", "ns")

UNIT_NAMES: Final = {
    **{name: name for units in (ANGLES, LENGTHS, SPEEDS, TIMES) for name in units},
    **dict.fromkeys(("degree", "degrees", "°", "degs"), "deg"),
    "1e7": "e7",
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("feet", "foot"), "ft"),
    **dict.fromkeys(("mps", "ms-1", "m/sec", "meters/second", "meters/sec"), "m/s"),
    **dict.fromkeys(("kmh", "kph", "kmph", "km/hr"), "km/h"),
    **dict.fromkeys(("mmps", "mm/sec"), "mm/s"),
    **dict.fromkeys(("knot", "knots", "kt", "kts"), "kn"),
    **dict.fromkeys(("mi/h", "miles/h"), "mph"),
    **dict.fromkeys(("sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("µs", "μs", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
"""Units as they are written at names, by the unit."""

DIGIT: Final = re.compile(r"[0-9]")
HEMISPHERES: Final = "NSEWnsew"
MARKS: Final = re.compile(r"[°º˚'’′\"”″:\s]+|deg|min|sec")
DEGREE_MARKS: Final = re.compile(r"[°º˚:]|deg")


def degrees(cell: str, letter: str = "") -> float:
    """Read degrees, minutes and seconds such as 52°30'00"N, or 5230.000N as in NMEA 0183.

    `letter` is the hemisphere if another cell has it. NaN without a usable number, and for
    several numbers with neither a mark of degrees nor a hemisphere.
    """
    text = cell.strip()
    if not DIGIT.search(text):
        return math.nan
    for end in (text[0], text[-1]):
        letter = end if end in HEMISPHERES else letter
    hemisphere = letter.upper()
    parts = [part for part in MARKS.split(text.strip(HEMISPHERES).replace(",", ".")) if part]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return math.nan
    others = numbers[1:]
    if others:
        marked = hemisphere or DEGREE_MARKS.search(text)
        whole_numbers = all(part.is_integer() for part in numbers[:-1])
        within = len(others) <= 2 and all(0.0 <= part < 60.0 for part in others)
        if not (marked and whole_numbers and within):
            return math.nan
    size = sum(abs(part) / 60.0**k for k, part in enumerate(numbers))
    if not others and hemisphere and size > (90.0 if hemisphere in "NS" else 180.0):
        whole, minutes = divmod(size, 100.0)
        size = whole + minutes / 60.0 if minutes < 60.0 else math.nan
    return -size if hemisphere in ("S", "W") or parts[0].startswith("-") else size
