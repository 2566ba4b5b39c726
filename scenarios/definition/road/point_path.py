"""The path through recorded points."""

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.road.pieces import drivable_pieces
from scenarios.definition.road.recorded_place import place_of
from scenarios.definition.road.usable_width import UndrivableError, road_through
from scenarios.definition.schema.path_tables import PointsPath, SegmentsPath
from scenarios.definition.traces.part import MOST_LISTED, PATH_KEYS, pieces_in_words
from vehicles.geometry.bridges import step_lengths
from vehicles.geometry.smoothing import SmoothedPath

LONGEST = 86_400.0
"""Longest run (s): a day."""

LONGEST_PATH = 1_000_000.0
"""Longest road (m) of all laps, which takes two points per metre."""


def smoothed_points(table: PointsPath, lead_in: float, keys: str = PATH_KEYS) -> SmoothedPath:
    """Smooth points, with a straight of at least `lead_in` m before them; raises SettingError.

    The names of the keys that select a part of the drive begin with `keys`.
    """
    key = f"path ({table.source})" if table.source else "path"
    points = np.array((table.east_m, table.north_m))
    check_length(table, float(np.sum(step_lengths(points))), keys)
    try:
        return road_through(points, table, lead_in)
    except UndrivableError as error:
        where = f"{place_of(table, error.point)}: {error}"
        raise SettingError(key, f"{where}: {_remedy(table, error, lead_in, keys)}") from error
    except ValueError as error:
        raise SettingError(key, str(error)) from error


def _remedy(table: PointsPath, error: UndrivableError, lead_in: float, keys: str) -> str:
    can_cut = table.source and not table.closed
    pieces = drivable_pieces(table, error.sections, lead_in) if can_cut else []
    if pieces:
        longest = sorted(pieces, key=lambda piece: -piece.length)[:MOST_LISTED]
        unit, last = "s" if table.time_s else "m", len(table.east_m) - 1
        words = pieces_in_words(longest, len(pieces), unit, keys, last)
        return f"these parts can be driven: {words}"
    remedy = "end the drive before it, or start after it"
    if keys == PATH_KEYS:
        remedy += ", or lower path.smoothing_m if a car can drive it"
    return remedy


def check_span(key: str, table: PointsPath, keys: str = PATH_KEYS) -> None:
    """Raise SettingError for a drive that is longer than a run can be; `keys` select a part."""
    if not table.time_s:
        return
    times = np.asarray(table.time_s)
    span = float(times[-1]) - float(times[0])
    if span <= LONGEST:
        return
    with np.errstate(over="ignore"):
        steps = np.diff(times)
    longest = int(np.argmax(steps))
    rest = span - float(steps[longest])
    remedy = f"select a part with {keys}from_s and {keys}to_s"
    if rest <= LONGEST and table.pauses == "keep" and keys == PATH_KEYS:
        remedy += ', or leave pauses out with path.pauses = "cut"'
    raise SettingError(
        key,
        f"recorded times span {span:.6g} s, allowed at most {LONGEST:g}: the longest interval is "
        f"{float(steps[longest]):.6g} s after {place_of(table, longest)}: {remedy}",
    )


def check_length(table: SegmentsPath | PointsPath, lap: float, keys: str = PATH_KEYS) -> None:
    """Raise SettingError for a path that takes too much memory; `lap` is its length (m)."""
    if lap * table.laps > LONGEST_PATH:
        key = "path.laps" if table.laps > 1 else "path"
        whole_km, most_km = lap * table.laps / 1000.0, LONGEST_PATH / 1000.0
        remedy = ""
        if table.laps > 1:
            remedy = ": drive fewer laps"
        elif isinstance(table, PointsPath) and table.source:
            unit = "m" if keys == PATH_KEYS else "s"
            remedy = f": select a part with {keys}from_{unit} and {keys}to_{unit}"
        raise SettingError(
            key, f"{whole_km:.6g} km of road, allowed at most {most_km:g} km{remedy}"
        )
