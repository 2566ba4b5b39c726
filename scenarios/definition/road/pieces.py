"""The pieces of a recorded drive that a car can drive forwards."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from scenarios.definition.road.recorded_place import recorded_times
from scenarios.definition.road.usable_width import UndrivableError, road_through
from scenarios.definition.schema.path_tables import PointsPath
from vehicles.geometry.bridges import step_lengths
from vehicles.geometry.sampled_path import FloatArray
from vehicles.geometry.smoothing import MIN_POINTS, Sections

SHORTEST = 30.0
"""Shortest piece (m): what is shorter may be driven in reverse, such as in a three-point turn."""

MARGIN = 1.0
"""Distance (m) along the points that is left out on either side of a section without a path."""

MOST_TRIED, MOST_LISTED = 20, 3
"""Number of pieces that are tried, and of those that are listed."""


@dataclass(frozen=True, slots=True)
class DrivablePart:
    """A drivable piece of a drive, from point `first` to `last`, and its length (m).

    `begin` and `end` are the times (s) of both since the start of the recorded drive, or without
    times the distances (m) along its points, rounded to 0.1 towards the piece.
    """

    first: int
    last: int
    begin: float
    end: float
    length: float


def drivable_pieces(table: PointsPath, sections: Sections, lead_in: float) -> list[DrivablePart]:
    """Find the pieces of a drive between `sections` without a path, each confirmed by smoothing."""
    points = np.array((table.east_m, table.north_m))
    along = np.concatenate((np.zeros(1), np.cumsum(step_lengths(points))))
    axis = recorded_times(table) if table.time_s else table.begin_m + along
    waiting, pieces = _between(sections, 0, along.size - 1, along), list[DrivablePart]()
    for _ in range(MOST_TRIED):
        if not waiting:
            break
        longest = max(waiting, key=lambda ends: float(along[ends[1]] - along[ends[0]]))
        waiting.remove(longest)
        first, last = longest
        begin, end = float(axis[first]), float(axis[last])
        if first > 0:
            begin = math.ceil(10.0 * begin) / 10.0
            first = int(np.searchsorted(axis, begin - 1e-9))
        if last < along.size - 1:
            end = math.floor(10.0 * end) / 10.0
            last = int(np.searchsorted(axis, end + 1e-9, side="right")) - 1
        try:
            road = road_through(points[:, first : last + 1], table, lead_in)
        except UndrivableError as error:
            inner = [(first + begun, first + ended) for begun, ended in error.sections]
            waiting += _between(inner, first, last, along)
        except ValueError:
            continue
        else:
            pieces.append(DrivablePart(first, last, begin, end, road.lap_length))
    return sorted(pieces, key=lambda piece: piece.first)


def _between(
    sections: Iterable[tuple[int, int]], first: int, last: int, along: FloatArray
) -> list[tuple[int, int]]:
    """Return the first and last point of each long piece between sections and both ends."""
    result, begin = [], first
    for left, right in (*sections, (along.size, last)):
        end = last
        if left < along.size:
            end = int(np.searchsorted(along, along[left] - MARGIN, side="right")) - 1
        if end - begin >= MIN_POINTS and along[end] - along[begin] >= SHORTEST:
            result.append((begin, end))
        begin = max(begin, int(np.searchsorted(along, along[right] + MARGIN)))
    return result


def pieces_in_words(table: PointsPath, pieces: Sequence[DrivablePart], *, has_keys: bool) -> str:
    """List the longest pieces, and the keys of the path that select one if it `has_keys`."""
    longest = sorted(pieces, key=lambda piece: -piece.length)[:MOST_LISTED]
    listed = sorted(longest, key=lambda piece: piece.first)
    unit, last = "s" if table.time_s else "m", len(table.east_m) - 1
    places = ", ".join(
        f"{piece.begin:g} to {piece.end:.1f} {unit} ({piece.length:.0f} m)" for piece in listed
    )
    more = f" and {len(pieces) - len(listed)} more" if len(pieces) > len(listed) else ""
    keys = "set " + ", or ".join(_keys(piece, unit, last) for piece in listed)
    remedy = keys if has_keys else "cut the file"
    return f"these parts can be driven: {places}{more}: {remedy}"


def _keys(piece: DrivablePart, unit: str, last: int) -> str:
    begin = [f"path.from_{unit} = {piece.begin:.1f}"] if piece.first > 0 else []
    end = [f"path.to_{unit} = {piece.end:.1f}"] if piece.last < last else []
    return " and ".join(begin + end)
