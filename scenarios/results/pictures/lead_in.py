"""The true poses before a part of a run that its true errors need."""

from collections.abc import Mapping, Sequence
from math import cos, sin

import numpy as np

from transport.columns import Columns
from transport.log.reader import LogReader
from vehicles.schedule import SECOND

LEAD_IN_NS = (10 * SECOND, 30 * SECOND, 90 * SECOND)
"""Times before the part that are read in turn, until every follower has driven over the place at
which the lead began."""
SLOWEST = 1.0
"""Smallest speed (m/s) of the lead at that place: at a standstill its path has no direction."""
ASIDE_M, TURNED = 5.0, 0.8
"""Largest distance from that place across the path, and smallest cosine of the angle to it."""
Key = tuple[str, str]


def with_lead_in(
    reader: LogReader, vehicles: Sequence[str], span_ns: tuple[int, int]
) -> dict[Key, Columns] | None:
    """True poses (lead first) that give the errors in a span of instants; None if all are needed.

    The errors are those of the whole run: the path of the lead is a polyline through its poses,
    and each follower is passed on from the place at which the part of that path begins.
    """
    for before in LEAD_IN_NS:
        wider = span_ns[0] - before, span_ns[1]
        recorded = reader.recorded_span(["truth"], vehicles, wider)
        if recorded is None:
            return None
        truth = reader.columns(["truth"], vehicles=vehicles, span_ns=recorded)
        if recorded[0] <= reader.first_at:  # from the start of the run on
            return truth
        # A pose that was recorded in the span may be as much older.
        oldest = span_ns[0] - (recorded[1] - wider[1])
        poses = {vehicle: rows for (vehicle, _), rows in truth.items() if len(rows)}
        chosen = _from_one_place(poses, vehicles[0], oldest) if vehicles[0] in poses else None
        if chosen is not None:
            return {(vehicle, "truth"): rows for vehicle, rows in chosen.items()}
    return None


def _from_one_place(
    poses: Mapping[str, Columns], lead: str, until: int
) -> dict[str, Columns] | None:
    """Poses from the first place of the lead on; None if a follower passes it after `until`."""
    first = {name: float(poses[lead][name][0]) for name in ("east_m", "north_m", "yaw_rad")}
    if poses[lead]["speed_mps"][0] < SLOWEST:
        return None
    chosen = {lead: poses[lead]}
    for vehicle, rows in poses.items():
        if vehicle == lead:
            continue
        east, north = rows["east_m"] - first["east_m"], rows["north_m"] - first["north_m"]
        along_east, along_north = cos(first["yaw_rad"]), sin(first["yaw_rad"])
        along = east * along_east + north * along_north
        aside = np.abs(along_east * north - along_north * east)
        is_parallel = np.cos(rows["yaw_rad"] - first["yaw_rad"]) > TURNED
        passes = (along[1:] >= 0.0) & (along[:-1] < 0.0) & (aside < ASIDE_M)[1:] & is_parallel[1:]
        crossings = np.flatnonzero(passes) + 1
        if not len(crossings) or rows.at_ns[crossings[0]] > until:
            return None
        chosen[vehicle] = rows.of(np.arange(crossings[0], len(rows)))
    return chosen
