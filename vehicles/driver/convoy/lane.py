"""The strip that a car sweeps along its path, and what reaches into it; SI units."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vehicles.car.outline import Outline
from vehicles.car.parameters import VehicleParameters
from vehicles.geometry.sampled_path import FloatArray, SampledPath

SIDE_MARGIN: Final = 0.3  # Distance (m) to either side of the lead's body that must be free
SHARES: Final = np.linspace(0.0, 1.0, 33)  # Points between two samples, at most 8 mm apart


class LapRange(NamedTuple):
    """Stations (m) of a path to search, and what to add to them after its end."""

    low: float
    high: float
    added: float


def lap_ranges(path: SampledPath, lap: float, station: float, distance: float) -> list[LapRange]:
    """Ranges of the path within `distance` (m) ahead of `station` (m).

    Beyond the end of a closed path, whose lap is `lap` (m) long, they are those of the last lap.
    """
    end, until = float(path.station[-1]), station + distance
    ranges = [LapRange(station, min(until, end), 0.0)] if station < end else []
    if lap and until > end:
        begin = max(station, end) - lap
        ranges.append(LapRange(begin, min(until, end + lap) - lap, lap))
    return ranges


class Lane:
    """The strip that the body of a car sweeps along its path, with a margin on either side.

    The outer front corner sweeps sqrt((R + w/2)² + l²) - R to the side in a bend of radius R, for a
    car of width w whose front bumper is l ahead of its centre of mass.
    """

    def __init__(self, path: SampledPath, car: VehicleParameters) -> None:
        self._path = path
        self._width = car.width
        self.front = 0.5 * car.length + car.body_offset
        self._squares = 0.25 * car.width**2 + self.front**2
        self._widest = float(np.max(self._half_widths(path.curvature)))

    def first_contact(
        self, body: Outline, low: float, high: float, margin: float = 0.0
    ) -> float | None:
        """First station (m) from `low` to `high` at which the strip meets `body`.

        `margin` (m) widens the strip. None without a contact.
        """
        return next(iter(self.contacts(body, low, high, margin)), None)

    def contacts(self, body: Outline, low: float, high: float, margin: float = 0.0) -> list[float]:
        """Stations (m) from `low` to `high` at which the strip begins to meet `body`, in order.

        `margin` (m) widens the strip.
        """
        path = self._path
        first, last = np.searchsorted(path.station, (low, high)).tolist()
        dx, dy = path.east[first:last] - body.east, path.north[first:last] - body.north
        reach = self.reach(body) + margin
        near = np.flatnonzero(dx * dx + dy * dy <= reach * reach) + first
        if not near.size:
            return []
        samples = (path.station, path.east, path.north, path.yaw, path.curvature)
        met = near[self._meets(body, margin, [values[near] for values in samples[1:]])]
        begins = met[np.diff(met, prepend=-2) > 1].tolist()
        return [self._begin(body, margin, index, samples, first=first) for index in begins]

    def reach(self, body: Outline) -> float:
        """Distance (m) from the centre of `body` within which the strip can meet it."""
        return body.reach + self._widest

    def _begin(
        self, body: Outline, margin: float, index: int, samples: Sequence[FloatArray], *, first: int
    ) -> float:
        """Station (m) of a contact that a sample has and the one before it has not."""
        if index == first:
            return float(samples[0][index])
        station, *place = (
            values[index - 1] + SHARES * (values[index] - values[index - 1]) for values in samples
        )
        return float(station[int(np.argmax(self._meets(body, margin, place)))])

    def _meets(
        self, body: Outline, margin: float, samples: Sequence[FloatArray]
    ) -> NDArray[np.bool_]:
        """Whether the line across the strip at each sample meets the body (slab method)."""
        east, north, yaw, curvature = samples
        dx, dy = east - body.east, north - body.north
        ux, uy = body.along_east, body.along_north
        half = self._half_widths(curvature) + margin
        cosine, sine = np.cos(yaw), np.sin(yaw)
        enters, leaves = -half, half
        for place, slope, size in (
            (dx * ux + dy * uy, uy * cosine - ux * sine, body.half_length),
            (dy * ux - dx * uy, ux * cosine + uy * sine, body.half_width),
        ):
            steep = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
            near, far = (-size - place) / steep, (size - place) / steep
            enters = np.maximum(enters, np.minimum(near, far))
            leaves = np.minimum(leaves, np.maximum(near, far))
        return enters <= leaves

    def _half_widths(self, curvature: FloatArray) -> FloatArray:
        bend = np.abs(curvature)
        swept = self._width + bend * self._squares
        return swept / (np.sqrt(1.0 + bend * swept) + 1.0) + SIDE_MARGIN
