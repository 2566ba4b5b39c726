"""Recorded drives with defects, and the true course of each.

A car drives straights and arcs at a given speed, with stops. The receiver adds noise, drift, jumps
and holes.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario, scenario_from_text
from tests.made.scenarios.recorded_drives import (
    ORIGIN,
    Drive,
    as_geodetic_csv,
    as_gpx,
    as_nmea,
    as_plane_csv,
)

Course = tuple[tuple[float, float], ...]
"""Length (m) and curvature (1/m) of each piece."""

UTM = (300_000.0, 3_900_000.0)

STRAIGHT = ((400.0, 0.0),)
LEFT = ((60.0, 0.0), (200.0, 1 / 60.0), (100.0, 0.0))
RIGHT = ((60.0, 0.0), (250.0, -1 / 120.0), (100.0, 0.0))
BLOCK = tuple([(60.0, 0.0), (0.5 * math.pi * 12.0, 1 / 12.0)] * 3 + [(60.0, 0.0)])
SWEEP = ((300.0, 1 / 300.0), (300.0, -1 / 200.0))
ON_THE_SPOT = ((150.0, 0.0), (math.pi * 0.6, 1 / 0.6), (150.0, 0.0))


def without_times(points: Drive) -> bytes:
    return "\n".join(["x_m,y_m", *(f"{e!r},{n!r}" for _, e, n, _ in points)]).encode()


def without_speeds(points: Drive) -> bytes:
    return "\n".join(["t_s,x_m,y_m", *(f"{t!r},{e!r},{n!r}" for t, e, n, _ in points)]).encode()


FORMATS: dict[str, Callable[[Drive], bytes]] = {
    "csv": as_plane_csv,
    "wgs84": as_geodetic_csv,
    "gpx": as_gpx,
    "nmea": as_nmea,
    "places": without_times,
    "timed": without_speeds,
}
SUFFIXES = {
    "csv": "csv",
    "wgs84": "csv",
    "gpx": "gpx",
    "nmea": "nmea",
    "places": "csv",
    "timed": "csv",
}


@dataclass(frozen=True, kw_only=True)
class Rough:
    """One file: `course` is (length m, curvature 1/m) pieces, `stands` (at m, for s).

    `holes` (from m, length m) have no points. `jumps` displacements of at least `jump_size` (m)
    last `jump_length` points each. `drift` (m) is the standard deviation of a slow drift. `keys`
    are lines of the table [path]. `twice`: each point occurs twice.
    """

    course: Course = LEFT
    speed: float = 10.0
    rate_hz: float = 10.0
    noise: float = 0.02
    drift: float = 0.0
    keys: str = ""
    holes: tuple[tuple[float, float], ...] = ()
    jumps: int = 0
    jump_length: int = 1
    jump_size: float = 2.0
    stands: tuple[tuple[float, float], ...] = ()
    offset: tuple[float, float] = (0.0, 0.0)
    form: str = "csv"
    seed: int = 1
    twice: bool = False

    @property
    def is_geodetic(self) -> bool:
        return self.form in {"wgs84", "gpx", "nmea"}

    @property
    def file_name(self) -> str:
        return f"drive.{SUFFIXES[self.form]}"

    def write(self) -> bytes:
        return FORMATS[self.form](self.points())

    def points(self) -> Drive:
        random = np.random.default_rng(self.seed)
        stations, speeds = self._motion()
        east, north = truth(self.course, stations)
        count = stations.size
        east, north = (
            axis
            + random.normal(0.0, self.noise, count)
            + slow_drift(random, count, self.drift, 20.0 * self.rate_hz)
            for axis in (east, north)
        )
        for k in random.choice(np.arange(20, count - 20, 25), self.jumps, replace=False):
            angle = random.uniform(0.0, 2.0 * math.pi)
            size = self.jump_size * random.uniform(1.0, 1.5)
            east[k : k + self.jump_length] += size * math.cos(angle)
            north[k : k + self.jump_length] += size * math.sin(angle)
        kept = np.ones(count, dtype=bool)
        for begin, length in self.holes:
            kept &= ~((stations > begin) & (stations < begin + length))
        rows = zip(
            np.arange(count) / self.rate_hz,
            east + self.offset[0],
            north + self.offset[1],
            speeds,
            strict=True,
        )
        return [
            (round(float(t), 6), float(e), float(n), float(v))
            for (t, e, n, v), keep in zip(rows, kept, strict=True)
            for _ in range(2 if self.twice else 1)
            if keep
        ]

    def _motion(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stations and speeds at each instant, with 2 m/s² around each stop."""
        end = sum(length for length, _ in self.course)
        waits = dict(self.stands)
        station, speed, waited = 0.0, 0.0 if 0.0 in waits else self.speed, 0.0
        stations, speeds, step = [], [], 0.01
        next_out, at = 0.0, 0.0
        places = sorted(waits)
        while station < end and at < 600.0:
            if at >= next_out - 1e-9:
                stations.append(station)
                speeds.append(speed)
                next_out += 1.0 / self.rate_hz
            at += step
            if places and station >= places[0] - 0.02:
                speed, waited = 0.0, waited + step
                if waited >= waits[places[0]]:
                    places.pop(0)
                    waited = 0.0
                continue
            left = places[0] - station if places else math.inf
            speed = min(self.speed, speed + 2.0 * step, math.sqrt(2.0 * 2.0 * left) + 0.01)
            station += speed * step
            if not places and end in waits and station >= end:
                break
        return np.array(stations), np.array(speeds)


def slow_drift(
    random: np.random.Generator, count: int, size: float, memory: float
) -> NDArray[np.float64]:
    """A slow drift of standard deviation `size` and correlation length `memory` (points)."""
    keep = math.exp(-1.0 / memory)
    drift = np.zeros(count)
    shocks = random.normal(0.0, size * math.sqrt(1.0 - keep * keep), count) if size else drift
    value = random.normal(0.0, size) if size else 0.0
    for k, shock in enumerate(shocks.tolist()):
        value = keep * value + shock
        drift[k] = value
    return drift


def truth(
    course: Course, stations: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """East and north (m) at `stations` (m) of a course that starts eastward at the origin."""
    east, north = np.zeros(stations.size), np.zeros(stations.size)
    x = y = yaw = begin = 0.0
    for place, (length, curvature) in enumerate(course):
        last = place == len(course) - 1
        here = (stations >= begin) & ((stations < begin + length) | last)
        s = np.append(stations[here] - begin, length)
        if curvature:
            dx = (np.sin(yaw + curvature * s) - math.sin(yaw)) / curvature
            dy = (math.cos(yaw) - np.cos(yaw + curvature * s)) / curvature
        else:
            dx, dy = s * math.cos(yaw), s * math.sin(yaw)
        east[here], north[here] = x + dx[:-1], y + dy[:-1]
        x, y, yaw, begin = x + dx[-1], y + dy[-1], yaw + curvature * length, begin + length
    return east, north


def path_errors(
    rough: Rough, east: NDArray[np.float64], north: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance (m) of each position from the course."""
    length = sum(piece for piece, _ in rough.course)
    xs, ys = truth(rough.course, np.arange(0.0, length + 0.1, 0.2))
    dx, dy = np.diff(xs), np.diff(ys)
    errors = []
    for x, y in zip(east.tolist(), north.tolist(), strict=True):
        rx, ry = x - xs[:-1], y - ys[:-1]
        share = np.clip((rx * dx + ry * dy) / (dx * dx + dy * dy + 1e-12), 0.0, 1.0)
        errors.append(float(np.min(np.hypot(rx - share * dx, ry - share * dy))))
    return np.array(errors)


PLACE = (
    f"[origin]\nlatitude_deg = {ORIGIN.latitude_deg}\nlongitude_deg = {ORIGIN.longitude_deg}\n"
    f"altitude_m = {ORIGIN.altitude_m}\n"
)


def text_of(rough: Rough, folder: Path, more: str = "") -> str:
    (folder / rough.file_name).write_bytes(rough.write())
    text = (
        f'name = "rough"\n{more}[path]\nkind = "trace"\nfile = "{rough.file_name}"\n{rough.keys}\n'
    )
    text += PLACE if rough.is_geodetic else ""
    text += "" if rough.form == "places" else '[speed]\nlead = "recorded"\n'
    return text


def scenario_of(rough: Rough, folder: Path, more: str = "") -> Scenario:
    return scenario_from_text(text_of(rough, folder, more), label="rough.toml", folder=folder)


@dataclass(frozen=True, kw_only=True)
class Expected:
    """Largest distance (m) of the path from the truth, and counts of `check`.

    `patterns` match lines of `check`; `refused` matches the only error line.
    """

    off: float = 0.08
    jumps: tuple[int, int] = (0, 0)
    stands: int = 0
    holes: int = 0
    patterns: tuple[str, ...] = ()
    refused: str = ""


def holed(length: float, course: Course, form: str, speed: float = 10.0) -> Rough:
    return Rough(course=course, holes=((120.0, length),), form=form, speed=speed)


def bridged_hole(length: float) -> tuple[str, ...]:
    lengths = "|".join(f"{length + more:.0f}" for more in (-1.0, 0.0, 1.0, 2.0))
    return (rf"a hole of ({lengths})\.\d m after (line|point) \d+.* is bridged",)


HAIRPIN = ((150.0, 0.0), (math.pi * 8.0, 1 / 8.0), (150.0, 0.0))
APART = r"line \d+ \(.* s\): a hole of 22\.\d m whose sides point .* from each other"
STOPS = ((100.0, 20.0), (250.0, 10.0))
PHONE_STOPS = ((150.0, 60.0), (400.0, 30.0))
TURNS_BACK = r"(line|point) 7\d\d \(75\.\d s\): the points double back near .*: these parts"

CASES: dict[str, tuple[Rough, Expected]] = {
    "utm": (
        Rough(offset=UTM),
        Expected(patterns=("3912 km from .* 300000 m are subtracted .* eastings, 3900000 m from",)),
    ),
    **{
        f"hole of {length:g} m on a straight, {form}": (
            holed(length, STRAIGHT, form),
            Expected(holes=1, off=0.06, patterns=bridged_hole(length)),
        )
        for length, form in (
            (5.0, "csv"), (10.0, "gpx"), (20.0, "nmea"), (30.0, "places"), (50.0, "wgs84")
        )
    },
    **{
        f"hole of {length:g} m on an arc, {form}": (
            holed(length, LEFT, form),
            Expected(holes=1, patterns=bridged_hole(length)),
        )
        for length, form in (
            (5.0, "places"), (10.0, "csv"), (20.0, "gpx"), (30.0, "timed"), (50.0, "nmea")
        )
    },
    "hole of 50 m on a right arc": (
        holed(50.0, RIGHT, "wgs84", speed=15.0), Expected(holes=1, off=0.1)
    ),
    # The start of a bend within the hole is unknown.
    "hole over the beginning of an arc": (
        Rough(holes=((50.0, 30.0),)), Expected(holes=1, off=0.4)
    ),
    "three holes": (
        Rough(course=SWEEP, holes=((50.0, 10.0), (150.0, 30.0), (290.0, 50.0)), speed=20.0),
        Expected(holes=3, off=0.5),
    ),
    "hole at a corner of a block": (
        Rough(course=BLOCK, holes=((53.0, 8.0),), speed=5.0), Expected(holes=1, off=0.3)
    ),
    "jumps": (
        Rough(course=SWEEP, jumps=8, rate_hz=20.0, speed=15.0),
        Expected(jumps=(8, 8)),
    ),
    "jumps without times": (
        Rough(course=SWEEP, jumps=8, rate_hz=20.0, speed=15.0, form="places"),
        Expected(jumps=(8, 8)),
    ),
    "jumps by kilometres": (
        Rough(course=SWEEP, jumps=3, jump_size=1500.0, speed=15.0),
        Expected(patterns=("3 records are left out",)),
    ),
    "jumps on a block": (Rough(course=BLOCK, jumps=4, speed=5.0), Expected(jumps=(4, 4))),
    "standing start": (
        Rough(stands=((0.0, 20.0),)),
        Expected(stands=1, patterns=(r"starts at its first movement, at line 20\d \(0\.0 s\)",)),
    ),
    "two stops": (
        Rough(stands=STOPS, form="timed"),
        Expected(stands=2, patterns=(r"a pause of 2.\.. s", r"a pause of 1.\.. s")),
    ),
    "stop with drift": (
        Rough(drift=0.3, stands=((150.0, 40.0),)),
        Expected(stands=1, off=1.0),
    ),
    "phone with two stops, gpx": (
        Rough(course=SWEEP, noise=2.5, rate_hz=1.0, speed=13.0, stands=PHONE_STOPS, form="gpx"),
        Expected(stands=2, off=5.0, patterns=("points scatter by 2", "are noisy")),
    ),
    "phone that drifts": (
        Rough(
            course=SWEEP, noise=0.2, drift=2.5, rate_hz=1.0, speed=13.0, stands=PHONE_STOPS,
            form="gpx",
        ),
        Expected(stands=2, off=8.0, patterns=("points scatter by",)),
    ),
    "two points a second, with a stop": (
        Rough(course=SWEEP, rate_hz=2.0, speed=25.0, stands=((250.0, 12.0),)),
        Expected(stands=1),
    ),
    "a point a second, with a stop, gpx": (
        Rough(course=SWEEP, rate_hz=1.0, speed=20.0, stands=((250.0, 30.0),), form="gpx"),
        Expected(stands=1, off=0.15),
    ),
    "every point twice": (Rough(twice=True, form="gpx"), Expected()),
    "jumps, every point twice": (
        Rough(course=SWEEP, jumps=8, speed=15.0, twice=True), Expected(jumps=(8, 8))
    ),
    "a point between two holes": (
        Rough(holes=((120.0, 19.5), (140.5, 20.0))), Expected(holes=2, off=0.6)
    ),
    "turn on the spot": (
        Rough(course=ON_THE_SPOT, speed=2.0), Expected(refused=TURNS_BACK)
    ),
    "out and back on the spot, utm": (
        Rough(course=ON_THE_SPOT, speed=2.0, offset=UTM, form="timed"), Expected(refused=TURNS_BACK)
    ),
    "hole in a turn": (
        Rough(course=HAIRPIN, holes=((140.0, 60.0),)),
        Expected(refused=APART),
    ),
    "all of it": (
        Rough(
            course=SWEEP, offset=UTM, holes=((200.0, 25.0),), jumps=5, speed=15.0,
            stands=((0.0, 10.0), (400.0, 15.0)),
        ),
        Expected(stands=2, holes=1, jumps=(5, 5), patterns=("3912 km", "a hole of 2[5-7]")),
    ),
}  # fmt: skip
"""Files by name, with expected results."""
