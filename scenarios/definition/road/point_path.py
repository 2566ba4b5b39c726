"""The path through recorded points."""

from collections.abc import Sequence

import numpy as np

from scenarios.definition.errors import SettingError
from scenarios.definition.road.pieces import DrivablePart, drivable_pieces, pieces_in_words
from scenarios.definition.road.recorded_place import place_of
from scenarios.definition.road.usable_width import UndrivableError, road_through
from scenarios.definition.schema.path_tables import PointsPath, SegmentsPath
from vehicles.geometry.bridges import step_lengths
from vehicles.geometry.smoothing import SmoothedPath

LONGEST = 86_400.0
"""Longest run (s): a day."""

LONGEST_PATH = 1_000_000.0
"""Longest road (m) of all laps, which takes two points per metre."""


def smoothed_points(table: PointsPath, lead_in: float, *, is_replay: bool = False) -> SmoothedPath:
    """Smooth points, with a straight of at least `lead_in` m before them; raises SettingError.

    The keys of [path] cannot select a piece of a drive that `is_replay`.
    """
    key = f"path ({table.source})" if table.source else "path"
    points = np.array((table.east_m, table.north_m))
    check_length(table, float(np.sum(step_lengths(points))))
    try:
        return road_through(points, table, lead_in)
    except UndrivableError as error:
        where = f"{place_of(table, error.point)}: {error}"
        can_cut = table.source and not table.closed
        pieces = drivable_pieces(table, error.sections, lead_in) if can_cut else []
        remedy = _remedy(table, pieces, has_keys=not is_replay)
        raise SettingError(key, f"{where}: {remedy}") from error
    except ValueError as error:
        raise SettingError(key, str(error)) from error


def _remedy(table: PointsPath, pieces: Sequence[DrivablePart], *, has_keys: bool) -> str:
    if pieces:
        return pieces_in_words(table, pieces, has_keys=has_keys)
    return (
        "end the drive before it, or start after it, or lower path.smoothing_m if a car can drive "
        "it"
    )


def check_span(key: str, table: PointsPath) -> None:
    """Raise SettingError for a drive that is longer than a run can be."""
    if not table.time_s:
        return
    times = np.asarray(table.time_s)
    steps = np.diff(times)
    span = float(times[-1] - times[0])
    if span <= LONGEST:
        return
    longest = int(np.argmax(steps))
    rest = span - float(steps[longest])
    remedy = "select a part with path.from_s and path.to_s"
    if rest <= LONGEST and table.pauses == "keep":
        remedy += ', or leave pauses out with path.pauses = "cut"'
    raise SettingError(
        key,
        f"recorded times span {span:.6g} s, allowed at most {LONGEST:g}: the longest interval is "
        f"{float(steps[longest]):.6g} s after {place_of(table, longest)}: {remedy}",
    )


def check_length(table: SegmentsPath | PointsPath, lap: float) -> None:
    """Raise SettingError for a path that takes too much memory; `lap` is its length (m)."""
    if lap * table.laps > LONGEST_PATH:
        key = "path.laps" if table.laps > 1 else "path"
        whole_km, most_km = lap * table.laps / 1000.0, LONGEST_PATH / 1000.0
        remedy = ""
        if table.laps > 1:
            remedy = ": drive fewer laps"
        elif isinstance(table, PointsPath) and table.source:
            remedy = ": select a part with path.from_m and path.to_m"
        raise SettingError(
            key, f"{whole_km:.6g} km of road, allowed at most {most_km:g} km{remedy}"
        )
