"""Points along a composite trajectory, for pictures of it."""

import math
from typing import Final

from vehicles.geometry.arc_spline import clothoid_chord
from vehicles.messages import CompositeTrajectory

LONGEST_M: Final = 1000.0  # Longest trajectory (m) that is drawn, whatever a message contains


def points_along(
    trajectory: CompositeTrajectory, spacing_m: float
) -> list[tuple[float, float, float]]:
    """List points (east_m, north_m, yaw_rad) along the arcs and clothoids, including both ends.

    Neighbours are at most `spacing_m` apart, and pieces share their common point. Skips pieces
    with values that are not finite, as the message may be from any sender.
    """
    points: list[tuple[float, float, float]] = []
    left = LONGEST_M
    for piece in zip(
        trajectory.piece_east_m,
        trajectory.piece_north_m,
        trajectory.piece_yaw_rad,
        trajectory.piece_curvature_per_m,
        trajectory.piece_curvature_rate_per_m2,
        trajectory.piece_length_m,
        strict=False,
    ):
        if not all(map(math.isfinite, piece)):
            continue
        east, north, yaw, curvature, rate, length = piece
        length = max(0.0, min(length, left))
        left -= length
        cos_yaw, sin_yaw = math.cos(yaw), math.sin(yaw)
        steps = max(1, math.ceil(length / spacing_m))
        for step in range(1 if points else 0, steps + 1):
            along = length * step / steps
            ahead, across = _chord(curvature, rate, along)
            points.append(
                (
                    east + ahead * cos_yaw - across * sin_yaw,
                    north + ahead * sin_yaw + across * cos_yaw,
                    yaw + along * (curvature + 0.5 * rate * along),
                )
            )
    return points


def _chord(curvature: float, rate: float, along: float) -> tuple[float, float]:
    """Point `along` (m) after the start of a piece, in the frame of the start; exact for arcs.

    The chord of an arc of length s and curvature κ has the direction κs/2 and the length
    s·sin(κs/2)/(κs/2).
    """
    if rate != 0.0:
        return clothoid_chord(curvature, rate, along)
    half_turn = 0.5 * curvature * along
    chord = along * (math.sin(half_turn) / half_turn if abs(half_turn) > 1e-9 else 1.0)
    return chord * math.cos(half_turn), chord * math.sin(half_turn)
