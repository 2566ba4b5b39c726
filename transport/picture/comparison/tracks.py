"""The vehicles of several runs as arrays, for their common picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class PlottedCurve(NamedTuple):
    """Values over time (s after the start) and over the distance along the path (m), (N) each."""

    at_s: Floats
    station_m: Floats
    values: Floats


class ModeStart(NamedTuple):
    """A mode of a vehicle, from a time (s) and a distance along the path (m) on."""

    at_s: float
    station_m: float
    mode: str


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleTrack:
    """One vehicle of the run `run` (A, B, …), at `place` in its convoy.

    `body` is its length and width (m), and the distance of its middle ahead of its pose. Positions
    (N) are in the common plane (m), `yaw_rad` is counter-clockwise from east. `curves` are by
    quantity: error, gap, and from the second run on the difference from the first one.
    """

    run: str
    vehicle: str
    place: int
    body: tuple[float, float, float]
    at_s: Floats
    station_m: Floats
    east_m: Floats
    north_m: Floats
    yaw_rad: Floats
    curves: dict[str, PlottedCurve]
    modes: Sequence[ModeStart]


@dataclass(frozen=True, slots=True, kw_only=True)
class DivergencePoint:
    """The first place at which two runs differ, with a sentence about it."""

    vehicle: str
    at_s: float
    station_m: float
    east_m: float
    north_m: float
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedTracks:
    """All that the picture of several runs shows.

    `path` is east and north of the common path (m), `lane_m` the width of its lane, `spacing_m` the
    usual spacing of two vehicles, and `text` a description in Markdown.
    """

    vehicles: Sequence[str]
    tracks: Sequence[VehicleTrack]
    path: tuple[Sequence[float], Sequence[float]]
    lane_m: float
    spacing_m: float
    divergence: DivergencePoint | None
    text: str
