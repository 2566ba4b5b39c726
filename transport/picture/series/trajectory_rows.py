"""Points along many composite trajectories at once, for the picture of a log."""

from typing import NamedTuple

import numpy as np

from transport.columns import Array, Columns, Integers
from vehicles.geometry.arc_spline import (
    INNER_WEIGHT,
    MIDDLE_WEIGHT,
    NODE_1,
    NODE_2,
    NODE_4,
    NODE_5,
    OUTER_WEIGHT,
)
from vehicles.geometry.trajectory_points import LONGEST_M

_NODES = (
    (NODE_1, OUTER_WEIGHT),
    (NODE_2, INNER_WEIGHT),
    (0.5, MIDDLE_WEIGHT),
    (NODE_4, INNER_WEIGHT),
    (NODE_5, OUTER_WEIGHT),
)
PIECE_FIELDS = (
    "piece_east_m",
    "piece_north_m",
    "piece_yaw_rad",
    "piece_curvature_per_m",
    "piece_curvature_rate_per_m2",
    "piece_length_m",
)


class PieceColumns(NamedTuple):
    """Pieces of many trajectories in order; trajectory k has those from `offsets[k]` on.

    Shapes: offsets (K + 1), the other arrays (number of pieces); m, rad, 1/m, 1/m².
    """

    offsets: Integers
    east: Array
    north: Array
    yaw: Array
    curvature: Array
    rate: Array
    length: Array


def all_points_along(pieces: PieceColumns, spacing_m: float) -> tuple[Integers, Array]:
    """Points of many trajectories as by `points_along`: counts (K) and joined points (N, 2)."""
    owner = np.repeat(np.arange(len(pieces.offsets) - 1), np.diff(pieces.offsets))
    finite = np.isfinite(np.column_stack(pieces[1:])).all(axis=1)
    owner = owner[finite]
    east, north, yaw, curvature, rate, length = (column[finite] for column in pieces[1:])
    first = np.concatenate(([True], owner[1:] != owner[:-1]))[: len(owner)]
    length = _within_longest(np.maximum(length, 0.0), np.flatnonzero(first))
    steps = np.maximum(1, np.ceil(length / spacing_m)).astype(np.int64)
    counts = steps + first
    piece = np.repeat(np.arange(len(steps)), counts)
    step = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts) + ~first[piece]
    along = length[piece] * step / steps[piece]
    ahead, across = _chords(curvature[piece], rate[piece], along)
    cos_yaw, sin_yaw = np.cos(yaw)[piece], np.sin(yaw)[piece]
    points = np.column_stack(
        (
            east[piece] + ahead * cos_yaw - across * sin_yaw,
            north[piece] + ahead * sin_yaw + across * cos_yaw,
        )
    )
    of_each = np.bincount(owner, weights=counts, minlength=len(pieces.offsets) - 1)
    return of_each.astype(np.int64), points


def _within_longest(length: Array, firsts: Array) -> Array:
    """Cut the lengths of pieces where their trajectory exceeds LONGEST_M."""
    ends = np.cumsum(length)
    before = np.zeros(len(length))
    before[firsts] = np.diff(np.concatenate(([0.0], (ends - length)[firsts])))
    starts = ends - length - np.cumsum(before)
    return np.maximum(0.0, np.minimum(length, LONGEST_M - starts))


def _chords(curvature: Array, rate: Array, along: Array) -> tuple[Array, Array]:
    """Ends of arcs and clothoids as by `_chord`, for arrays."""
    half_turn = 0.5 * curvature * along
    chord = along * np.sinc(half_turn / np.pi)
    ahead, across = chord * np.cos(half_turn), chord * np.sin(half_turn)
    bent = np.flatnonzero(rate)
    length, half = along[bent], 0.5 * rate[bent]
    ahead[bent] = across[bent] = 0.0
    for node, weight in _NODES:
        turn = node * length
        turn *= curvature[bent] + half * turn
        ahead[bent] += weight * np.cos(turn)
        across[bent] += weight * np.sin(turn)
    ahead[bent] *= length
    across[bent] *= length
    return ahead, across


def pieces_of(trajectories: Columns, rows: Integers) -> PieceColumns:
    lists = [trajectories.lists[name].of(rows) for name in PIECE_FIELDS]
    return PieceColumns(lists[0].offsets, *(column.values for column in lists))
