"""Units of tables, and their names."""

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
