"""Common area of two bodies, by an independent method."""

from itertools import pairwise

from scenarios.results.true_motion import Bodies, corners

Point = tuple[float, float]


def common_area(first: Bodies, second: Bodies) -> float:
    """Area (m²) of the intersection of two bodies, by Sutherland-Hodgman clipping."""
    shape, window = ring(first), ring(second)
    for start, end in pairwise([*window, window[0]]):
        shape = _left_of(shape, start, end)
    return 0.5 * sum(
        shape[k - 1][0] * shape[k][1] - shape[k][0] * shape[k - 1][1] for k in range(len(shape))
    )


def ring(body: Bodies) -> list[Point]:
    """Corners of one body, counter-clockwise."""
    return [(float(east[0]), float(north[0])) for east, north in corners(body)]


def _left_of(shape: list[Point], start: Point, end: Point) -> list[Point]:
    (e0, n0), (e1, n1) = start, end
    sides = [(e1 - e0) * (n - n0) - (n1 - n0) * (e - e0) for e, n in shape]
    kept: list[Point] = []
    for k, ((east, north), side) in enumerate(zip(shape, sides, strict=True)):
        (east_before, north_before), side_before = shape[k - 1], sides[k - 1]
        if (side >= 0.0) != (side_before >= 0.0):
            share = side_before / (side_before - side)
            crossing = (
                east_before + share * (east - east_before),
                north_before + share * (north - north_before),
            )
            kept.append(crossing)
        if side >= 0.0:
            kept.append((east, north))
    return kept
