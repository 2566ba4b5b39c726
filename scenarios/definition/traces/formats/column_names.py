"""Meaning of the columns of a table by their names."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

# ---- Units of tables, and their names


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


# ---- Column names


LATITUDES: Final = ("lat", "latitude", "breite", "breitengrad")
LONGITUDES: Final = ("lon", "lng", "long", "longitude", "länge", "längengrad", "laengengrad")
PLANES: Final = (
    ("x", "y"), ("east", "north"), ("easting", "northing"), ("e", "n"),
    ("ebaseline", "nbaseline"), ("xeast", "ynorth"), ("eastx", "northy"),
    ("tx", "ty"), ("prsrx", "prsry"),
)  # fmt: skip
ALTITUDES: Final = ("alt", "altitude", "ele", "elev", "elevation", "height", "h", "höhe")
GROUND_SPEEDS: Final = (
    "speed", "velocity", "vel", "v", "spd", "groundspeed", "speedoverground", "sog", "gspeed",
    "speed2d", "hspeed", "mph", "kmh", "kph", "knots", "geschwindigkeit",
)  # fmt: skip
DATES: Final = ("date", "datum")
STAMPS: Final = ("stamp", "headerstamp")
CLOCKS: Final = (
    "t", "time", "times", "timestamp", "timestamps", "datetime", "timestring", "gpst", "utc",
    "unix", "epoch", "isotime", "isodate", "timeofday", "timeoffix", "fixtime",
    "utime", "globaltime", "zeit", "uhrzeit", "zeitstempel",
)  # fmt: skip
ELAPSED: Final = (
    "elapsed", "elapsedtime", "secondselapsed", "relativetime", "sec", "secs", "seconds", "ms",
    "us", "ns", "tow", "itow",
)  # fmt: skip

NANOSECONDS: Final = ("nanosec", "nsec", "nsecs", "nanosecs", "nanoseconds")

ADDITIONS: Final = (
    "gps", "gnss", "pos", "position", "wgs84", "fix", "nav", "ins", "rtk", "utc", "utm", "unix",
    "epoch", "local", "msl", "decimal", "ros", "field", "vehicle", "car", "ego", "rel",
)  # fmt: skip
"""Words that add nothing to the name of a column, as in gps_lat or time_utc."""

NOT_PLACES: Final = re.compile(
    r"acc|veloc|twist|orient|angular|gyro|imu|mag|quat|rotat|covar|error|std|linear|rpy|vel"
)
"""Prefixes of x and y that are no position."""

BRACKETS: Final = re.compile(r"\s*[(\[{<]\s*([^)\]}>]*?)\s*[)\]}>]")
CAMEL: Final = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


@dataclass(frozen=True, slots=True)
class NamedColumn:
    """A column by its place, its name in the file, and the parts of the name.

    `prefix` is the path before the last name, as in "/gps/fix/latitude". `base` is the name
    without additions and unit. `stem` and `ending` are all words but the last, and the last.
    """

    place: int
    name: str
    prefix: str
    base: str
    unit: str | None
    stem: str
    ending: str


@dataclass(frozen=True, slots=True)
class TimeSource:
    """Columns that give the time: one, or two that are read together.

    A "stamp" has seconds and nanoseconds, a "date" date and time of day. `gps` marks a calendar
    without leap seconds.
    """

    kind: Literal["single", "stamp", "date"]
    columns: tuple[NamedColumn, ...]
    gps: bool = False

    @property
    def unit(self) -> str | None:
        unit = self.columns[-1].unit
        return unit if unit in TIMES else None


@dataclass(frozen=True, slots=True)
class TableColumns:
    """Usable columns of a table; `times` holds all sources of times, the preferred one first."""

    names: tuple[str, ...]
    geodetic: bool
    position: tuple[NamedColumn, ...]
    altitude: NamedColumn | None
    speed: NamedColumn | None
    times: tuple[TimeSource, ...]

    @property
    def rank(self) -> int:
        """The number of recognised kinds of columns."""
        return 1 + bool(self.altitude) + bool(self.speed) + bool(self.times)


def usable_columns(names: Sequence[str]) -> TableColumns | None:
    """Return the usable ones of these columns; None without a position."""
    columns = [parsed(place, name) for place, name in enumerate(names)]
    position = _geodetic(columns) or _plane(columns)
    if position is None:
        return None
    sideways = any(column.base == "vy" for column in columns)
    speeds = GROUND_SPEEDS if sideways else (*GROUND_SPEEDS, "vx")
    return TableColumns(
        names=tuple(names),
        geodetic=position[0].base in LATITUDES,
        position=position,
        altitude=_preferred(columns, ALTITUDES, LENGTHS),
        speed=_preferred(columns, speeds, SPEEDS),
        times=tuple(sorted(_times(columns), key=_time_rank)),
    )


def parsed(place: int, name: str) -> NamedColumn:
    """Split the name of a column into its parts."""
    text = re.sub(r"\s(N/S|E/W)$", "", name.strip().strip("\"'#% "))
    unit = None
    if match := BRACKETS.search(text):
        unit = UNIT_NAMES.get(match[1].lower())
        text = text[: match.start()] + text[match.end() :]
    text = re.sub("km/h$", "kmh", re.sub("m/s$", "mps", text), flags=re.IGNORECASE)
    path = [part for part in re.split(r"[./:]+", CAMEL.sub("_", text).lower()) if part.strip("_ ")]
    words = [[word for word in re.split(r"[\s_\-,]+", part) if word] for part in path]
    last = words[-1] if words else [""]
    every = [word for part in words for word in part] or [""]
    if len(last) > 2 and "_".join(last[-2:]) in ("km_h", "m_s", "mm_s"):
        last = [*last[:-2], "/".join(last[-2:])]
    if len(last) > 1 and last[-1] in UNIT_NAMES:
        unit = unit or UNIT_NAMES[last[-1]]
        last = last[:-1]
    base = "".join([word for word in last if word not in ADDITIONS] or last)
    if unit is None and base.endswith(("deg", "rad")) and base[:-3] in LATITUDES + LONGITUDES:
        base, unit = base[:-3], base[-3:]
    if unit is None and base in UNIT_NAMES:
        unit = UNIT_NAMES[base]
    if base in ("itow", "utime"):
        unit = unit or ("ms" if base == "itow" else "us")
    shown = "".join(letter if letter.isprintable() else "?" for letter in name.strip(" \t\"'")[:40])
    return NamedColumn(
        place, shown, "/".join(path[:-1]), base, unit, "_".join(every[:-1]), every[-1]
    )


def _geodetic(columns: list[NamedColumn]) -> tuple[NamedColumn, ...] | None:
    return _pair(columns, LATITUDES, LONGITUDES)


def _plane(columns: list[NamedColumn]) -> tuple[NamedColumn, ...] | None:
    places = [column for column in columns if not NOT_PLACES.search(column.prefix)]
    pairs = (_pair(places, (first,), (second,)) for first, second in PLANES)
    return next((pair for pair in pairs if pair), None)


def _pair(
    columns: list[NamedColumn], firsts: tuple[str, ...], seconds: tuple[str, ...]
) -> tuple[NamedColumn, ...] | None:
    """Return the first two columns of these names with the same prefix."""
    for column in columns:
        if column.base in firsts:
            for other in columns:
                if other.base in seconds and other.prefix == column.prefix:
                    return column, other
    return None


def _preferred(
    columns: list[NamedColumn], names: tuple[str, ...], units: dict[str, float]
) -> NamedColumn | None:
    """Return a column of these names: in the unit of the project, in a known unit, or else."""
    (own, _), *_ = units.items()
    fitting = [column for column in columns if column.base in names]
    return min(
        fitting,
        key=lambda column: 0 if column.unit == own else 1 if column.unit in units else 2,
        default=None,
    )


def _times(columns: list[NamedColumn]) -> Iterator[TimeSource]:
    date = next((column for column in columns if column.base in DATES), None)
    for column in columns:
        if column.ending in ("sec", "secs"):
            for other in columns:
                if other.ending in NANOSECONDS and other.stem == column.stem:
                    yield TimeSource("stamp", (column, other))
        if column.base in (*STAMPS, *CLOCKS, *ELAPSED) and column.unit in (None, *TIMES):
            if date:
                yield TimeSource("date", (date, column), column.base == "gpst")
            yield TimeSource("single", (column,), column.base == "gpst")
    if date:
        yield TimeSource("single", (date,))


def _time_rank(source: TimeSource) -> int:
    """Order sources: stamps of the measurement, clocks, dates alone, then elapsed times."""
    column = source.columns[-1]
    if source.kind == "stamp":
        return 0 if "stamp" in column.stem else 3
    if column.base in STAMPS:
        return 1
    return 4 if column.base in CLOCKS else 5 if column.base in DATES else 6
