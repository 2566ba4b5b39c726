"""The paper's own trajectory: a straight line if the samples pass its test, else one circle.

Section III-B joins the first and the last sample of the preview by a line L. If all samples lie
within 10 cm of L the trajectory is straight, else the circle that minimises J of eq. (5). Section
III-A instead keeps the longest straight prefix and fits the circle to the rest, which swallows
arcs. Both are implemented for comparison with `curve_fit`.

Departures: samples are in order of travel. They are centred, rotated along L and scaled, because
the three linear equations are ill-conditioned far from the origin. The circle has a sign. The
heading is that of the fitted line or circle, not of the two closest samples, which can lie side by
side.
"""

from math import atan2, hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from vehicles.geometry.arc_fits import ONE, LocalCurve, Samples, X, Y, average_graphs, max_abs
from vehicles.geometry.arc_spline import near_arc, on_clothoid
from vehicles.preview.curve_fit import (
    SPAN_MIN,
    Curve,
    FitSettings,
    in_world,
    local_frame,
    samples_in,
)

Floats = NDArray[np.float64]
_sum = np.add.reduce

PREFIX_LEAST = 3  # The k ≥ 3 of Section III-A: least number of samples of a straight prefix
DETERMINED = 1e-12  # Below this share of the squared spread the samples do not determine a circle


def recipe_curve(columns: Floats, weight: Floats | None, settings: FitSettings) -> Curve | None:
    """Line or circle of Section III-B through samples in order of station.

    `columns` are east, north (world) and station (m), shape (3, n); `weight` are the weights in J
    of eq. (5), one each if None; `settings.tolerance` is the paper's 10 cm. The trajectory
    `paper_prefix` first splits off the longest straight prefix of Section III-A. None with fewer
    than three samples, travel shorter than `SPAN_MIN`, or equal first and last positions.
    """
    station = columns[2]
    if len(station) < PREFIX_LEAST or station.item(-1) - station.item(0) < SPAN_MIN:
        return None
    frame = local_frame(columns, 0, 0, -1)
    if frame is None:
        return None
    samples = samples_in(frame, columns, weight)
    x, y, each = samples.rows[X], samples.rows[Y], samples.weighted[ONE]
    if max_abs(y) < settings.tolerance:
        return in_world(_line(samples), samples, frame)
    count = 0
    if settings.trajectory == "paper_prefix":
        count = _straight_prefix(x, y, settings.tolerance)
    curve = _circle(x[count:], y[count:], each[count:]) if len(x) - count >= PREFIX_LEAST else None
    if count:
        line = _line(samples_in(frame, columns[:, :count], each[:count]))
        curve = _continued(line, x.item(count - 1), y.item(count - 1), curve)
    return in_world(curve or _line(samples), samples, frame)


def circle_of_least_squares(
    x: Floats, y: Floats, weight: Floats
) -> tuple[float, float, float] | None:
    """Centre and radius (X_c, Y_c, R) (m) that minimise J of eq. (5); None if undetermined.

    Three linear equations in X_c, Y_c and R² − X_c² − Y_c² (Section III-A.1). About the weighted
    mean the third one decouples; lengths are divided by the spread of the samples.
    """
    total = float(_sum(weight))
    mean_x, mean_y = float(_sum(weight * x)) / total, float(_sum(weight * y)) / total
    dx, dy = x - mean_x, y - mean_y
    size = sqrt(float(_sum(weight * (dx * dx + dy * dy))) / total)
    if not size > 0.0:
        return None
    dx, dy = dx / size, dy / size
    square = dx * dx + dy * dy
    xx, xy, yy = (float(_sum(weight * product)) / total for product in (dx * dx, dx * dy, dy * dy))
    right_x = 0.5 * float(_sum(weight * dx * square)) / total
    right_y = 0.5 * float(_sum(weight * dy * square)) / total
    determinant = xx * yy - xy * xy
    if not determinant > DETERMINED:
        return None
    centre_x = (right_x * yy - right_y * xy) / determinant
    centre_y = (right_y * xx - right_x * xy) / determinant
    radius = sqrt(centre_x * centre_x + centre_y * centre_y + 1.0)  # the mean square is 1
    return mean_x + size * centre_x, mean_y + size * centre_y, size * radius


def _line(samples: Samples) -> LocalCurve:
    return average_graphs((samples.line(),), (1.0,))


def _circle(x: Floats, y: Floats, weight: Floats) -> LocalCurve | None:
    """Circle of eq. (5) in the direction of travel, from its middle; None if undetermined.

    The chord of an arc has the direction of the tangent at its middle, which distinguishes left
    from right turns.
    """
    circle = circle_of_least_squares(x, y, weight)
    if circle is None:
        return None
    centre_x, centre_y, radius = circle
    middle = len(x) // 2
    out_x, out_y = x.item(middle) - centre_x, y.item(middle) - centre_y
    away = hypot(out_x, out_y)
    if not away > 0.0:
        return None
    side = 1.0 if out_y < 0.0 else -1.0  # a left turn has its centre to the left
    out_x, out_y, bend = out_x / away, out_y / away, side / radius
    angle = atan2(side * out_x, -side * out_y)
    return LocalCurve(centre_x + radius * out_x, centre_y + radius * out_y, angle, bend, bend, 0.0)


def _straight_prefix(x: Floats, y: Floats, tolerance: float) -> int:
    """Number of samples in the longest straight prefix (Section III-A); 0 if there is none."""
    for count in range(len(x) - 1, PREFIX_LEAST - 1, -1):
        dx, dy = x[:count] - x.item(0), y[:count] - y.item(0)
        chord = hypot(dx.item(-1), dy.item(-1))
        if chord > 0.0 and max_abs(dy * dx.item(-1) - dx * dy.item(-1)) <= tolerance * chord:
            return count
    return 0


def _continued(line: LocalCurve, x: float, y: float, curve: LocalCurve | None) -> LocalCurve:
    """The line of a prefix up to its last sample (x, y) (m), then the curvature of `curve`."""
    start = line.x, line.y, line.angle
    join = on_clothoid(start, 0.0, 0.0, near_arc(start, 0.0, x, y).station)
    return LocalCurve(join.east, join.north, line.angle, 0.0, curve.after if curve else 0.0, 0.0)
