"""Meaning of the columns of a table by their names."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

# ---- Names and units


ANGLES = {"deg": 1.0, "rad": 57.29577951308232, "e7": 1e-7, "semicircles": 180 / 2**31}
LENGTHS = {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "ft": 0.3048}
SPEEDS = {
    "m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600, "mm/s": 1e-3, "ft/s": 0.3048
}  # fmt: skip
TIMES = ("s", "ms", "us", "ns")

UNIT_NAMES = {
    name: unit
    for unit, names in {
        **{unit: unit for units in (ANGLES, LENGTHS, SPEEDS, TIMES) for unit in units},
        "deg": "deg degree degrees ° degs", "e7": "e7 1e7", "rad": "rad radian radians",
        "m": "m metre metres meter meters", "ft": "ft feet foot",
        "m/s": "m/s mps ms-1 m/sec meters/second meters/sec", "mm/s": "mm/s mmps mm/sec",
        "km/h": "km/h kmh kph kmph km/hr", "kn": "kn knot knots kt kts", "mph": "mph mi/h miles/h",
        "s": "s sec secs second seconds", "ms": "ms msec msecs millis millisecond milliseconds",
        "us": "us µs μs usec usecs micros microseconds",
        "ns": "ns nsec nsecs nanos nanosec nanosecs nanoseconds",
    }.items()
    for name in names.split()
}  # fmt: skip
"""Units as they are written at names, by the unit."""

LATITUDES = ("lat", "latitude", "breite", "breitengrad")
LONGITUDES = ("lon", "lng", "long", "longitude", "länge", "längengrad", "laengengrad")
PLANES = (
    ("x", "y"), ("east", "north"), ("easting", "northing"), ("e", "n"),
    ("ebaseline", "nbaseline"), ("xeast", "ynorth"), ("eastx", "northy"),
    ("tx", "ty"), ("prsrx", "prsry"), ("globalx", "globaly"),
)  # fmt: skip
ALTITUDES = ("alt", "altitude", "ele", "elev", "elevation", "height", "h", "höhe")
GROUND_SPEEDS = (
    "speed", "velocity", "vel", "v", "spd", "groundspeed", "speedoverground", "sog", "gspeed",
    "speed2d", "hspeed", "vvel", "mph", "kmh", "kph", "knots", "geschwindigkeit", "vitesse",
)  # fmt: skip
DATES = ("date", "datum")
STAMPS = ("stamp", "headerstamp")
CLOCKS = (
    "t", "time", "times", "timestamp", "timestamps", "datetime", "timestring", "gpst", "utc",
    "unix", "epoch", "isotime", "isodate", "timeofday", "timeoffix", "fixtime", "timesteptime",
    "utime", "globaltime", "zeit", "uhrzeit", "zeitstempel", "temps",
)  # fmt: skip
ELAPSED = (
    "elapsed", "elapsedtime", "secondselapsed", "relativetime", "sec", "secs", "seconds", "ms",
    "us", "ns", "tow", "itow",
)  # fmt: skip
NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanosecs", "nanoseconds")
VEHICLES = ("id", "vehicleid", "trackid", "carid", "objectid", "agentid")

ADDITIONS = (
    "gps", "gnss", "pos", "position", "wgs84", "fix", "nav", "ins", "rtk", "utc", "utm", "unix",
    "epoch", "local", "msl", "decimal", "ros", "field", "vehicle", "car", "ego", "rel",
)  # fmt: skip
"""Words that add nothing to the name of a column, as in gps_lat or time_utc."""

NOT_PLACES = re.compile(
    r"acc|veloc|twist|orient|angular|gyro|imu|mag|quat|rotat|covar|error|std|linear|rpy|vel"
)
"""Prefixes of x and y that are no position."""

BRACKETS = re.compile(r"\s*[(\[{<]\s*([^)\]}>]*?)\s*[)\]}>]")
CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


class NamedColumn(NamedTuple):
    """A column by its place, its name in the file, and the parts of the name.

    `prefix` is the path before the last name, as in "/gps/fix/latitude". `base` is the name
    without additions and unit. `words` are all of its words.
    """

    place: int
    name: str
    prefix: str
    base: str
    unit: str | None
    words: tuple[str, ...]


class TimeSource(NamedTuple):
    """Columns that give the time: one, or two that are read together.

    A "stamp" has seconds and nanoseconds, a "date" date and time of day. `gps` marks a calendar
    without leap seconds.
    """

    kind: Literal["single", "stamp", "date"]
    columns: tuple[NamedColumn, ...]

    @property
    def unit(self) -> str | None:
        unit = self.columns[-1].unit
        return unit if unit in TIMES else None


@dataclass(frozen=True, slots=True)
class TableColumns:
    """Usable columns of a table; `times` holds all sources of times, the preferred one first.

    `vehicle` has the names of vehicles. `height` is the z of x and y.
    """

    names: tuple[str, ...]
    geodetic: bool
    position: tuple[NamedColumn, ...]
    altitude: NamedColumn | None
    speed: NamedColumn | None
    times: tuple[TimeSource, ...]
    vehicle: NamedColumn | None
    height: NamedColumn | None

    @property
    def rank(self) -> int:
        """The number of recognised kinds of columns."""
        return 1 + bool(self.altitude) + bool(self.speed) + bool(self.times)

    @property
    def unused(self) -> list[tuple[int, str]]:
        """Places and names of columns that are not read."""
        used = [*self.position, self.altitude, self.speed, self.vehicle]
        used += [column for source in self.times for column in source.columns]
        places = {column.place for column in used if column}
        return [(k, name.strip()) for k, name in enumerate(self.names) if k not in places]


def usable_columns(names: Sequence[str]) -> TableColumns | None:
    """Return the usable ones of these columns; None without a position."""
    columns = [parsed(place, name) for place, name in enumerate(names)]
    position = _pair(columns, LATITUDES, LONGITUDES)
    geodetic = position is not None
    if position is None:
        places = [column for column in columns if not NOT_PLACES.search(column.prefix)]
        pairs = (_pair(places, (first,), (second,)) for first, second in PLANES)
        position = next(filter(None, pairs), None)
    if position is None:
        return None
    if _is_ngsim(names):
        columns = [_in_feet(column) for column in columns]
        position = tuple(columns[column.place] for column in position)
    sideways = any(column.base == "vy" for column in columns)
    prefix = position[0].prefix
    return TableColumns(
        names=tuple(names),
        geodetic=geodetic,
        position=position,
        altitude=_preferred(columns, ALTITUDES, LENGTHS),
        speed=_preferred(columns, (*GROUND_SPEEDS, *(() if sideways else ("vx",))), SPEEDS),
        times=tuple(sorted(_times(columns), key=_time_rank)),
        vehicle=next((one for one in columns if "".join(one.words) in VEHICLES), None),
        height=next((one for one in columns if (one.base, one.prefix) == ("z", prefix)), None),
    )


def numbered(names: Sequence[str]) -> dict[str, TableColumns]:
    """Return the columns of each vehicle of a table with names such as Lat1, Lat2, if it has any.

    Columns of another vehicle have the name "".
    """
    ends = [re.fullmatch(r"(\D+?)_?(\d+)", name.strip(" \"'")) for name in names]
    numbers = dict.fromkeys(match[2] for match in ends if match)
    usable = {}
    for number in numbers:
        pairs = zip(names, ends, strict=True)
        mine = [name if m is None else m[1] if m[2] == number else "" for name, m in pairs]
        if columns := usable_columns(mine):
            usable[number] = columns
    return usable if len(usable) > 1 else {}


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
    every = tuple(word for part in words for word in part) or ("",)
    if len(last) > 2 and "_".join(last[-2:]) in ("km_h", "m_s", "mm_s"):
        last = [*last[:-2], "/".join(last[-2:])]
    if len(last) > 1 and last[-1] in UNIT_NAMES:
        unit = unit or UNIT_NAMES[last[-1]]
        last = last[:-1]
    base = "".join([word for word in last if word not in ADDITIONS] or last)
    if unit is None and base[-3:] in ("deg", "rad") and base[:-3] in LATITUDES + LONGITUDES:
        base, unit = base[:-3], base[-3:]
    unit = unit or {"itow": "ms", "utime": "us"}.get(base) or UNIT_NAMES.get(base)
    shown = "".join(letter if letter.isprintable() else "?" for letter in name.strip(" \t\"'")[:40])
    return NamedColumn(place, shown, "/".join(path[:-1]), base, unit, every)


def _is_ngsim(names: Sequence[str]) -> bool:
    return {"local_x", "v_vel"} <= {name.strip().lower() for name in names}


def _in_feet(column: NamedColumn) -> NamedColumn:
    return column._replace(
        unit={"x": "ft", "y": "ft", "vvel": "ft/s"}.get(column.base, column.unit)
    )


def _pair(
    columns: list[NamedColumn], firsts: tuple[str, ...], seconds: tuple[str, ...]
) -> tuple[NamedColumn, ...] | None:
    """Return the first two columns of these names with the same prefix."""
    pairs = (
        (column, other)
        for column in columns
        if column.base in firsts
        for other in columns
        if other.base in seconds and other.prefix == column.prefix
    )
    return next(pairs, None)


def _preferred(
    columns: list[NamedColumn], names: tuple[str, ...], units: dict[str, float]
) -> NamedColumn | None:
    """Return a column of these names: in the unit of the project, in a known unit, or else."""
    own = next(iter(units))
    fitting = [column for column in columns if column.base in names]
    return min(fitting, key=lambda one: (one.unit != own) + (one.unit not in units), default=None)


def _times(columns: list[NamedColumn]) -> Iterator[TimeSource]:
    date = next((column for column in columns if column.base in DATES), None)
    for column in columns:
        if column.words[-1] in ("sec", "secs"):
            for other in columns:
                if other.words[-1] in NANOSECONDS and other.words[:-1] == column.words[:-1]:
                    yield TimeSource("stamp", (column, other))
        if column.base in (*STAMPS, *CLOCKS, *ELAPSED) and column.unit in (None, *TIMES):
            if date:
                yield TimeSource("date", (date, column))
            yield TimeSource("single", (column,))
    if date:
        yield TimeSource("single", (date,))


def _time_rank(source: TimeSource) -> int:
    """Order sources: stamps of the measurement, clocks, dates alone, then elapsed times."""
    column = source.columns[-1]
    if source.kind == "stamp":
        return 0 if "stamp" in "_".join(column.words[:-1]) else 3
    if column.base in STAMPS:
        return 1
    return 4 if column.base in CLOCKS else 5 if column.base in DATES else 6
