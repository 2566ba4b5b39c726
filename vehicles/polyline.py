"""Points in order of travel with their arc length, and the nearest place within a stretch."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from math import hypot, inf


class Polyline:
    """Points (m) with an instant each (ns, ascending) and their station (m).

    Stations are never renumbered when points are dropped, so that a place keeps its station.
    """

    __slots__ = ("at", "dropped", "east", "north", "station")

    def __init__(self) -> None:
        """Start without points."""
        self.at: list[int] = []
        self.east: list[float] = []
        self.north: list[float] = []
        self.station: list[float] = []
        self.dropped = 0

    def __len__(self) -> int:
        """Points held."""
        return len(self.at)

    def append(self, at: int, east: float, north: float) -> None:
        """Add a point at the end."""
        station = 0.0
        if self.at:
            station = self.station[-1] + hypot(east - self.east[-1], north - self.north[-1])
        self.at.append(at)
        self.east.append(east)
        self.north.append(north)
        self.station.append(station)

    def insert(self, place: int, at: int, east: float, north: float) -> float:
        """Put a point before index `place` > 0; returns how far later stations move on (m)."""
        end = self.station[place] if place < len(self) else None
        self.at.insert(place, at)
        self.east.insert(place, east)
        self.north.insert(place, north)
        self.station.insert(place, 0.0)
        self._measure(place)
        return 0.0 if end is None else self.station[place + 1] - end

    def prepend(self, at: int, points: Sequence[tuple[float, float]]) -> None:
        """Put `points` before the first one, all at one instant; stations start anew from 0."""
        count = len(points)
        self.at[:0] = [at] * count
        self.east[:0] = [east for east, _ in points]
        self.north[:0] = [north for _, north in points]
        self.station[:0] = [0.0] * count
        self.station[0] = 0.0
        self._measure(1)

    def drop(self, count: int) -> None:
        """Forget the first `count` points."""
        self.dropped += count
        del self.at[:count], self.east[:count], self.north[:count], self.station[:count]

    def _measure(self, first: int) -> None:
        """Compute the stations from index `first` > 0 on."""
        for k in range(first, len(self.station)):
            step = hypot(self.east[k] - self.east[k - 1], self.north[k] - self.north[k - 1])
            self.station[k] = self.station[k - 1] + step

    def nearest(self, east: float, north: float, low: float, high: float) -> float:
        """Station (m) nearest to a place, of those from `low` to `high`.

        Needs two points, no two in a row alike. The end segments extend beyond the ends.
        """
        last = len(self.station) - 2
        first = min(max(bisect_right(self.station, low) - 1, 0), last)
        final = min(max(bisect_left(self.station, high) - 1, first), last)
        best, found = inf, 0.0
        for k in range(first, final + 1):
            length = self.station[k + 1] - self.station[k]
            along_east = (self.east[k + 1] - self.east[k]) / length
            along_north = (self.north[k + 1] - self.north[k]) / length
            off_east, off_north = east - self.east[k], north - self.north[k]
            foot = off_east * along_east + off_north * along_north
            start = low - self.station[k]
            end = high - self.station[k]
            if k > 0:
                start = max(start, 0.0)
            if k < last:
                end = min(end, length)
            foot = min(max(foot, start), end)
            away = hypot(off_east - foot * along_east, off_north - foot * along_north)
            if away < best:
                best, found = away, self.station[k] + foot
        return found
