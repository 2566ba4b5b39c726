"""Roads, motions of a car on them, and what a receiver records of it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.geodesy import LocalPlane, Origin

Floats = NDArray[np.float64]

PLACE = Origin(48.1, 11.5, 500.0)
"""Origin of the plane of all roads."""

START = 1_782_907_200.0
"""Unix time (s) at which all drives begin: 2026-07-01 12:00:00 UTC."""

STEP = 0.1
"""Distance (m) between samples of a road."""

HARDEST = 1.5
"""Largest acceleration along the road (m/s²)."""

HARDEST_ASIDE = 2.0
"""Largest acceleration across the road (m/s²)."""


@dataclass(frozen=True, kw_only=True)
class Fix:
    """A record of a receiver: Unix time (s), position (m) in the plane of PLACE, speed, height.

    A text instead of a number is written as it is; None is an empty cell. `degrees` replace the
    position in formats with latitudes. `row` replaces the record by a line of the file.
    """

    time: float | str | None
    east: float
    north: float
    speed: float | str | None
    height: float | str | None = 500.0
    degrees: tuple[float, float] | None = None
    row: str | None = None

    @property
    def latitude_longitude(self) -> tuple[float, float]:
        return self.degrees or degrees_of(self.east, self.north)


def degrees_of(east: float, north: float) -> tuple[float, float]:
    latitude, longitude, _ = LocalPlane(PLACE).to_geodetic(east, north)
    return latitude, longitude


@dataclass(frozen=True)
class Recording:
    """Records in the order of the file."""

    fixes: tuple[Fix, ...]

    def changed(self, fixes: Iterable[Fix]) -> "Recording":
        return Recording(tuple(fixes))

    def edited(self, numbers: Iterable[int], **fields: object) -> "Recording":
        places = set(numbers)
        return self.changed(
            replace(fix, **fields) if k in places else fix  # type: ignore[arg-type]
            for k, fix in enumerate(self.fixes)
        )


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A car on a road of (length m, curvature 1/m) pieces, joined by bends of length `ramp` (m).

    It drives at up to `speed` (m/s), and stops at `stops` (m along the road, s). The receiver
    records `rate_hz` fixes with white noise of standard deviation `noise` (m) per axis.
    """

    road: tuple[tuple[float, float], ...]
    ramp: float = 10.0
    heading: float = 0.3
    speed: float = 12.0
    stops: tuple[tuple[float, float], ...] = ()
    rate_hz: float = 10.0
    noise: float = 0.0
    seed: int = 1
    from_standstill: bool = False
    shape: "Shape" = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shape", _shape(self.road, self.ramp, self.heading))

    @property
    def length(self) -> float:
        return float(self.shape.station[-1])

    def motion(self) -> tuple[Floats, Floats, Floats]:
        """Times (s), stations (m) and speeds (m/s) of the car, with each stop twice."""
        station, curvature = self.shape.station, self.shape.curvature
        fastest = np.minimum(self.speed**2, HARDEST_ASIDE / np.maximum(np.abs(curvature), 1e-6))
        for place, _ in self.stops:
            fastest[round(place / STEP)] = 0.0
        if self.from_standstill:
            fastest[0] = 0.0
        slope = 2.0 * HARDEST * station
        fastest = np.minimum.accumulate(fastest - slope) + slope
        fastest = np.minimum.accumulate((fastest + slope)[::-1])[::-1] - slope
        speeds = np.sqrt(np.maximum(fastest, 0.0))
        steps = 2.0 * STEP / np.maximum(speeds[1:] + speeds[:-1], 1e-3)
        times = np.concatenate(([0.0], np.cumsum(steps)))
        for place, wait in sorted(self.stops, reverse=True):
            k = round(place / STEP)
            times = np.concatenate((times[: k + 1], times[k:] + wait))
            station = np.insert(station, k, station[k])
            speeds = np.insert(speeds, k, speeds[k])
        return times, station, speeds

    def recorded(self) -> Recording:
        random = np.random.default_rng(self.seed)
        times, stations, speeds = self.motion()
        at = np.arange(math.floor(times[-1] * self.rate_hz + 1e-6) + 1) / self.rate_hz
        places = np.interp(at, times, stations)
        noise = random.normal(0.0, self.noise, (2, at.size))
        east = np.interp(places, self.shape.station, self.shape.east) + noise[0]
        north = np.interp(places, self.shape.station, self.shape.north) + noise[1]
        rows = zip(
            at.tolist(), east.tolist(), north.tolist(), np.interp(at, times, speeds).tolist(),
            strict=True,
        )  # fmt: skip
        return Recording(
            fixes=tuple(
                Fix(
                    time=round(START + t, 6),
                    east=round(x, 4),
                    north=round(y, 4),
                    speed=round(v, 3),
                )
                for t, x, y, v in rows
            ),
        )


@dataclass(frozen=True)
class Shape:
    station: Floats
    east: Floats
    north: Floats
    curvature: Floats


def _shape(road: tuple[tuple[float, float], ...], ramp: float, heading: float) -> Shape:
    steps = np.concatenate([np.full(round(length / STEP), bend) for length, bend in road])
    width = 2 * round(0.5 * ramp / STEP) + 1
    padded = np.pad(steps, width // 2, mode="edge")
    mean = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    curvature = np.asarray(mean, dtype=np.float64)
    yaw = heading + np.concatenate(([0.0], np.cumsum(curvature) * STEP))
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    east = np.concatenate(([0.0], np.cumsum(np.cos(middle)) * STEP))
    north = np.concatenate(([0.0], np.cumsum(np.sin(middle)) * STEP))
    station = np.arange(curvature.size + 1, dtype=np.float64) * STEP
    return Shape(station, east, north, np.append(curvature, curvature[-1]))


BEND = ((120.0, 0.0), (140.0, 1.0 / 70.0), (100.0, 0.0))
U_TURN = ((120.0, 0.0), (math.pi * 9.0, 1.0 / 9.0), (120.0, 0.0))
LOOP = ((80.0, 0.0), (2.0 * math.pi * 30.0, -1.0 / 30.0), (80.0, 0.0))
S_BEND = ((80.0, 0.0), (70.0, 1.0 / 45.0), (70.0, -1.0 / 45.0), (80.0, 0.0))
