"""Drives as receivers record them, from a course that is known: the truth of each file.

A car goes over straights and arcs at a given speed, stands at places, and a receiver with noise,
drift, jumps and holes writes what it takes for its place.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.made.scenarios.recorded_drives import (
    Drive,
    as_geodetic_csv,
    as_gpx,
    as_nmea,
    as_plane_csv,
)

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

    `holes` (from m, length m) are without points. `jumps` points are off by 2 m or more, of which
    each lasts `jump_length` points. `drift` (m) is the standard deviation of a slow wander.
    """

    course: tuple[tuple[float, float], ...] = LEFT
    speed: float = 10.0
    rate_hz: float = 10.0
    noise: float = 0.02
    drift: float = 0.0
    holes: tuple[tuple[float, float], ...] = ()
    jumps: int = 0
    jump_length: int = 1
    jump_size: float = 2.0
    stands: tuple[tuple[float, float], ...] = ()
    offset: tuple[float, float] = (0.0, 0.0)
    form: str = "csv"
    seed: int = 1

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
            + wander(random, count, self.drift, 20.0 * self.rate_hz)
            for axis in (east, north)
        )
        for k in random.choice(np.arange(20, count - 20, 25), self.jumps, replace=False):
            angle = random.uniform(0.0, 2.0 * math.pi)
            size = self.jump_size * random.uniform(1.0, 1.5)
            east[k : k + self.jump_length] += size * math.cos(angle)
            north[k : k + self.jump_length] += size * math.sin(angle)
        seen = np.ones(count, dtype=bool)
        for begin, length in self.holes:
            seen &= ~((stations > begin) & (stations < begin + length))
        rows = zip(
            np.arange(count) / self.rate_hz,
            east + self.offset[0],
            north + self.offset[1],
            speeds,
            strict=True,
        )
        return [
            (round(float(t), 6), float(e), float(n), float(v))
            for (t, e, n, v), one in zip(rows, seen, strict=True)
            if one
        ]

    def _motion(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stations and speeds at the instants: 2 m/s² up and down around each stand."""
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


def wander(
    random: np.random.Generator, count: int, size: float, memory: float
) -> NDArray[np.float64]:
    """A slow drift of standard deviation `size` that forgets itself in `memory` points."""
    keep = math.exp(-1.0 / memory)
    found = np.zeros(count)
    shocks = random.normal(0.0, size * math.sqrt(1.0 - keep * keep), count) if size else found
    value = random.normal(0.0, size) if size else 0.0
    for k, shock in enumerate(shocks.tolist()):
        value = keep * value + shock
        found[k] = value
    return found


def truth(
    course: tuple[tuple[float, float], ...], stations: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """East and north (m) at `stations` (m) of a course that begins at the origin, going east."""
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


def off_the_truth(
    rough: Rough, east: NDArray[np.float64], north: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance (m) of each place from the course."""
    length = sum(piece for piece, _ in rough.course)
    xs, ys = truth(rough.course, np.arange(0.0, length + 0.1, 0.2))
    dx, dy = np.diff(xs), np.diff(ys)
    found = []
    for x, y in zip(east.tolist(), north.tolist(), strict=True):
        rx, ry = x - xs[:-1], y - ys[:-1]
        share = np.clip((rx * dx + ry * dy) / (dx * dx + dy * dy + 1e-12), 0.0, 1.0)
        found.append(float(np.min(np.hypot(rx - share * dx, ry - share * dy))))
    return np.array(found)
