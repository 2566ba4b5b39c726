"""NMEA 0183: the sentences of one instant become one point."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.traces.formats.nmea_sentences import KINDS, Integers, sentences_in
from scenarios.definition.traces.recorded_drive import (
    NO_FIX,
    Clock,
    Floats,
    LeftOut,
    LeftOutRecords,
    RecordedDrive,
    TraceError,
)

Rows = NDArray[Any]

DAY: Final = 86_400.0

CONTINUOUS_S: Final = 600.0
"""Largest step of the time between points that have one date in common."""


def read_nmea(text: str) -> RecordedDrive:
    """Read the positions of GGA, GNS, RMC and GLL, with the speeds of RMC or VTG.

    Each kind of sentence is in its own order; sentences of different kinds and of the same time
    become one point, wherever they are in the file. Dates of RMC or ZDA make Unix times; without
    a date times of day continue over midnight. Raises TraceError without a sentence.
    """
    left_out = LeftOutRecords()
    rows, checked = sentences_in(text, left_out)
    rows = _with_speeds(rows)
    if not rows.size:
        raise TraceError(_none(left_out))
    points, times = _merged(rows, _continued(rows))
    clock, zero_s, times = _dated(times, points["date"])
    located = np.isfinite(points["latitude"])
    listed = {record.number for record in left_out.records}
    for k in np.flatnonzero(~located & (points["kind"] != KINDS.index("ZDA"))).tolist():
        if (number := int(points["number"][k])) not in listed:
            left_out.add(LeftOut(number, NO_FIX, NO_FIX, float(times[k])))
    if not located.any():
        raise TraceError(_none(left_out))
    remarks = [] if checked else ["sentences have no checksums: wrong values may remain"]
    if unfit := int(points["unfit"][located].sum()):
        have = "position has" if unfit == 1 else "positions have"
        remarks.append(f"{unfit} {have} quality 0 or status V: used like the others")
    points, times = points[located], times[located]
    return RecordedDrive(
        geodetic=True,
        unit="line",
        numbers=points["number"].copy(),
        position=np.array((points["latitude"], points["longitude"])),
        altitude_m=points["altitude"].copy(),
        time_s=times,
        speed_mps=points["speed"].copy(),
        clock=clock if np.isfinite(times).any() else None,
        zero_s=zero_s,
        left_out=left_out,
        remarks=tuple(remarks),
    )


def _none(left_out: LeftOutRecords) -> str:
    first = left_out.lines("line")[:1]
    return ", ".join(("no valid GGA, RMC, GLL or GNS sentence", *first))


def _with_speeds(rows: Rows) -> Rows:
    """Move speeds of VTG to the sentence before each, unless there are speeds of RMC."""
    is_vtg = rows["kind"] == KINDS.index("VTG")
    if not is_vtg.any():
        return rows
    others: Rows = rows[~is_vtg]
    if others.size and not np.isfinite(others["speed"]).any():
        before = np.searchsorted(np.flatnonzero(~is_vtg), np.flatnonzero(is_vtg)) - 1
        others["speed"][np.maximum(before, 0)] = rows["speed"][is_vtg]
    return others


def _streams(rows: Rows) -> list[Integers]:
    """Return the places of the sentences of each kind and talker, the one with the most first.

    A kind of higher precedence comes first if it has at least half as many positions.
    """
    names, stream = np.unique(rows["kind"] * 65536 + rows["talker"], return_inverse=True)
    located = np.bincount(stream, np.isfinite(rows["latitude"]), minlength=names.size)
    few = 2 * located < located.max()
    order = np.lexsort((-located, names // 65536, few))
    return [np.flatnonzero(stream == k) for k in order.tolist()]


def _continued(rows: Rows) -> Floats:
    """Return the times of day, continued over midnight within each stream."""
    times, begin = rows["day_s"].copy(), math.nan
    for places in _streams(rows):
        known = places[np.isfinite(times[places])]
        if not known.size:
            continue
        times[known] += DAY * np.cumsum(np.diff(times[known], prepend=times[known[0]]) < -DAY / 2)
        if math.isfinite(begin):  # the streams begin on both sides of midnight
            times[known] -= DAY * np.rint((times[known[0]] - begin) / DAY)
        else:
            begin = times[known[0]]
    return times


def _merged(rows: Rows, times: Floats) -> tuple[Rows, Floats]:
    """Join the sentences of one instant, and return the points in the order of the first stream."""
    streams = _streams(rows)
    precedence, repeat = np.empty(rows.size, np.int64), np.empty(rows.size, np.int64)
    for rank, places in enumerate(streams):
        precedence[places] = rank
        repeat[places] = _repeats(times[places])
    order = np.lexsort((precedence, repeat, times))
    changed = np.diff(times[order], prepend=math.nan) != 0  # also at unknown times
    changed |= np.diff(repeat[order], prepend=-1) != 0
    group = np.cumsum(changed) - 1
    sorted_rows = rows[order]
    points = sorted_rows[changed]
    located = np.isfinite(sorted_rows["latitude"])
    for names, known in (
        (("latitude", "longitude", "number", "kind", "unfit"), located),
        (("altitude",), np.isfinite(sorted_rows["altitude"])),
        (("speed",), np.isfinite(sorted_rows["speed"])),
        (("date",), np.isfinite(sorted_rows["date"])),
    ):
        groups, firsts = np.unique(group[known], return_index=True)
        for name in names:
            points[name][groups] = sorted_rows[name][known][firsts]
    group_of = np.empty(rows.size, np.int64)
    group_of[order] = group
    sequence = _sequence(streams, group_of)
    return points[sequence], times[order][changed][sequence]


def _repeats(times: Floats) -> Integers:
    """Return how often each time occurred before."""
    order = np.lexsort((np.arange(times.size), times))
    changed = np.diff(times[order], prepend=math.nan) != 0
    begins = np.flatnonzero(changed)
    repeats = np.empty(times.size, np.int64)
    repeats[order] = np.arange(times.size) - begins[np.cumsum(changed) - 1]
    return repeats


def _sequence(streams: list[Integers], group_of: Integers) -> Integers:
    """Return the order of groups: that of the first stream, others next to their neighbours.

    The neighbour is the sentence before in the same stream, or else the one behind, so that streams
    may be logged one after the other. Streams without common times are in the order of the file.
    """
    first, count = streams[0], int(group_of.max()) + 1
    anchor_of = np.full(count, -1)
    anchor_of[group_of[first]] = first
    anchor, side = anchor_of.copy(), np.full(count, 0)
    for places in reversed(streams[1:]):
        own = anchor_of[group_of[places]]
        shared = np.flatnonzero(own >= 0)
        if shared.size:
            behind = np.searchsorted(shared, np.arange(places.size), side="right") - 1
            neighbour = own[shared[np.maximum(behind, 0)]]
        else:
            behind = np.searchsorted(first, places) - 1
            neighbour = first[np.maximum(behind, 0)]
        free, before = own < 0, behind < 0
        anchor[group_of[places[free]]] = neighbour[free]
        side[group_of[places[free]]] = (places + 1 - before * (group_of.size + 1))[free]
    return np.lexsort((side, anchor))


def _dated(times: Floats, dates: Floats) -> tuple[Clock, float, Floats]:
    """Return the clock, its zero and the times on it.

    Points whose times follow each other closely have the date of most of them: dates of a receiver
    before its first fix, or late at midnight, do not matter.
    """
    known = np.flatnonzero(np.isfinite(times))
    dated = np.isfinite(dates[known])
    if not dated.any():
        return "day", 0.0, times
    piece = np.cumsum(np.abs(np.diff(times[known], prepend=times[known[0]])) > CONTINUOUS_S)
    begins = DAY * (dates[known] - np.floor(times[known] / DAY))
    order = np.lexsort((begins[dated], piece[dated]))
    pieces, first, count = np.unique(piece[dated], return_index=True, return_counts=True)
    middle = begins[dated][order][first + (count - 1) // 2]
    begin = middle[np.maximum(np.searchsorted(pieces, piece, side="right") - 1, 0)]
    result = times.copy()
    result[known] += begin - begin[0]
    return "unix", float(begin[0]), result
