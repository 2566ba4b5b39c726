"""The pieces of a recorded drive that a car can drive forwards."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from scenarios.definition.road.recorded_place import recorded_times
from scenarios.definition.road.usable_width import UndrivableError, road_through
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.definition.traces.part import DrivePiece, piece_between
from vehicles.geometry.bridges import distances_along
from vehicles.geometry.sampled_path import FloatArray
from vehicles.geometry.smoothing import MIN_POINTS, Sections

SHORTEST = 30.0
"""Shortest piece (m): what is shorter may be driven in reverse, such as in a three-point turn."""

MARGIN = 1.0
"""Distance (m) along the points that is left out on either side of a section without a path."""

MOST_TRIED = 20
"""Number of pieces that are tried, unless they have more points than the drive."""


def drivable_pieces(table: PointsPath, sections: Sections, lead_in: float) -> list[DrivePiece]:
    """Find the pieces of a drive between `sections` without a path, each confirmed by smoothing."""
    points = np.array((table.east_m, table.north_m))
    along = distances_along(points)
    axis = recorded_times(table) if table.time_s else table.begin_m + along
    waiting, pieces = _between(sections, 0, along.size - 1, along), list[DrivePiece]()
    tried = 0
    for _ in range(MOST_TRIED):
        if not waiting or tried > along.size:
            break
        longest = max(waiting, key=lambda ends: float(along[ends[1]] - along[ends[0]]))
        waiting.remove(longest)
        piece = piece_between(*longest, axis, along)
        first, last = piece.first, piece.last
        tried += last - first
        try:
            road = road_through(points[:, first : last + 1], table, lead_in)
        except UndrivableError as error:
            inner = [(first + begun, first + ended) for begun, ended in error.sections]
            waiting += _between(inner, first, last, along)
        except ValueError:
            continue
        else:
            pieces.append(replace(piece, length=road.lap_length))
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
