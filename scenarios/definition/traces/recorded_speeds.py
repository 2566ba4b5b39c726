"""Recorded speeds of a drive that agree with its positions."""

import numpy as np

from scenarios.definition.traces.drive import FASTEST, Floats

WINDOW = 2.0
"""Time (s) over which positions give a speed."""

OFF_MPS, OFF_SHARE = 10.0, 0.5
"""Largest difference (m/s) of a recorded speed from that of the positions, or this share of it, if
that is more."""

WRONG_MAX = 0.1
"""Largest share of wrong speeds that are interpolated; with more of them speeds are unusable."""

MOVING = 2.0
"""Speed (m/s) from which on the ratio of speeds counts."""

RATIOS = (0.8, 1.25)
"""Recorded speed over that of the positions; outside of it speeds are not in m/s."""

UNITS = {3.6: "km/h", 1.9438: "knots", 2.2369: "mph"}
"""Units by their number in 1 m/s."""

SAME_UNIT = 0.05
"""Largest relative difference of a ratio from that of its unit."""


def usable_speeds(
    speed_mps: Floats, time_s: Floats, points: Floats
) -> tuple[Floats | None, tuple[str, ...]]:
    """Return a speed (m/s) per point of `points` (2, n), None without usable ones, and remarks.

    `time_s` is empty if times are unknown. Points without a speed take that of the previous one.
    Single absurd speeds are interpolated.
    """
    count = points.shape[1]
    known = np.flatnonzero(np.isfinite(speed_mps))
    if 2 * known.size <= count:
        return None, ()
    last = np.maximum(np.searchsorted(known, np.arange(count), side="right") - 1, 0)
    speeds = np.abs(speed_mps[known[last]])
    instead = "speeds follow from the times" if time_s.size else "speeds are ignored"
    if not speeds.any():
        return None, (f"every recorded speed is 0 while the position changes: {instead}",)
    derived = _derived(time_s, points) if time_s.size else np.full(count, np.nan)
    moving = derived >= MOVING
    ratio = float(np.median(speeds[moving] / derived[moving])) if moving.sum() >= 3 else 1.0
    if not RATIOS[0] <= ratio <= RATIOS[1]:
        unit = next((f" ({u}?)" for n, u in UNITS.items() if abs(ratio / n - 1.0) < SAME_UNIT), "")
        off = f"recorded speeds are {ratio:.2f} times what the positions need{unit}"
        return None, (f"{off}: {instead}",)
    differs = np.abs(speeds - derived) > np.maximum(OFF_MPS, OFF_SHARE * derived)
    wrong = differs | (speeds > FASTEST)
    found = speeds[wrong]
    if not found.size:
        return speeds, ()
    many = "recorded speeds, up to" if found.size > 1 else "recorded speed,"
    fault = f"{found.size} {many} {found.max():.4g} m/s, off the others"
    if found.size > WRONG_MAX * count:
        return None, (f"{fault}: {instead}",)
    at = time_s if time_s.size else np.arange(float(count))
    speeds[wrong] = np.interp(at[wrong], at[~wrong], speeds[~wrong])
    return speeds, (f"{fault}: interpolated",)


def _derived(at: Floats, points: Floats) -> Floats:
    """Return the speed (m/s) between points half a WINDOW before and after; NaN in silences."""
    k = np.arange(at.size)
    first = np.minimum(np.searchsorted(at, at - 0.5 * WINDOW), np.maximum(k - 1, 0))
    last = np.searchsorted(at, at + 0.5 * WINDOW, side="right") - 1
    last = np.maximum(last, np.minimum(k + 1, at.size - 1))
    span = at[last] - at[first]
    usual = float(np.median(np.diff(at))) if at.size > 1 else 0.0
    valid = (span > 0.0) & (span <= max(2.0 * WINDOW, 4.0 * usual))
    gone = np.hypot(*(points[:, last] - points[:, first]))
    return np.where(valid, gone / np.where(valid, span, 1.0), np.nan)
