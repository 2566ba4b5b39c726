"""Points along a composite trajectory, for pictures of it."""

import math

from vehicles.messages import CompositeTrajectory

LONGEST_M = 1000.0
"""No trajectory is drawn farther than this, whatever a message contains."""


def points_along(
    trajectory: CompositeTrajectory, spacing_m: float
) -> list[tuple[float, float, float]]:
    """List points (east_m, north_m, yaw_rad) along the arcs, ends included.

    Neighbours are at most `spacing_m` apart and pieces share the point where they meet. Exact on
    each arc: the chord to length s along a piece of curvature κ has the direction yaw + κs/2 and
    the length s·sin(κs/2)/(κs/2). Pieces with values that are not finite are left out: the message
    may come from any sender.
    """
    points: list[tuple[float, float, float]] = []
    left = LONGEST_M
    for piece in zip(
        trajectory.piece_east_m,
        trajectory.piece_north_m,
        trajectory.piece_yaw_rad,
        trajectory.piece_curvature_per_m,
        trajectory.piece_length_m,
        strict=False,
    ):
        if not all(map(math.isfinite, piece)):
            continue
        east, north, yaw, curvature, length = piece
        length = max(0.0, min(length, left))
        left -= length
        steps = max(1, math.ceil(length / spacing_m))
        for step in range(1 if points else 0, steps + 1):
            along = length * step / steps
            half_turn = 0.5 * curvature * along
            chord = along * (math.sin(half_turn) / half_turn if abs(half_turn) > 1e-9 else 1.0)
            points.append(
                (
                    east + chord * math.cos(yaw + half_turn),
                    north + chord * math.sin(yaw + half_turn),
                    yaw + 2.0 * half_turn,
                )
            )
    return points
