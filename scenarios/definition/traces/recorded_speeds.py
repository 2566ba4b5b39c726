"""Recorded speeds of a drive that agree with its positions."""

import numpy as np

from scenarios.definition.traces.drive import FASTEST, Floats, Mask, runs_of

WINDOW = 2.0
"""Time (s) over which positions give a speed."""

OFF_MPS, OFF_SHARE = 10.0, 0.5
"""Largest difference (m/s) of a recorded speed from its neighbours and from the positions, or this
share of their speed, if that is more."""

LONGEST_RUN = 5.0
"""Longest time (s) of wrong values; longer ones are no slips."""

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
    at = time_s if time_s.size else np.arange(float(count))
    ratio = float(np.median(speeds[moving] / derived[moving])) if moving.sum() >= 3 else 1.0
    if RATIOS[0] <= ratio <= RATIOS[1]:
        absurd = speeds > FASTEST
        if 2 * np.count_nonzero(absurd) > count:
            return None, (f"most recorded speeds are above {FASTEST:g} m/s: {instead}",)
        absurd |= _slips(speeds, derived, at, absurd)
        smooth = np.where(absurd, np.interp(at, at[~absurd], speeds[~absurd]), speeds)
        valid = derived < FASTEST  # False for NaN
        if np.count_nonzero(valid & moving) >= 3:  # of the distances
            spans = np.gradient(at)[valid]
            ratio = float(np.sum(spans * smooth[valid]) / np.sum(spans * derived[valid]))
        if RATIOS[0] <= ratio <= RATIOS[1]:
            found = speeds[absurd]
            many = "recorded speeds, up to" if found.size > 1 else "recorded speed,"
            fault = f"{found.size} {many} {found.max(initial=0.0):.4g} m/s, off the others"
            return smooth, (f"{fault}: interpolated",) if found.size else ()
    unit = next((f" ({u}?)" for n, u in UNITS.items() if abs(ratio / n - 1.0) < SAME_UNIT), "")
    off = f"recorded speeds are {ratio:.2f} times what the positions need{unit}"
    return None, (f"{off}: {instead}",)


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


def _slips(speeds: Floats, derived: Floats, at: Floats, absurd: Mask) -> Mask:
    """Mark short runs of speeds that fit neither the positions nor the speeds around the run."""
    off = absurd | _differs(speeds, derived)
    if off.all():
        return absurd
    around = np.interp(at, at[~off], speeds[~off])
    for first, last in runs_of(off):
        if at[last] - at[first] > LONGEST_RUN:
            off[first : last + 1] = False
    return np.asarray(off & _differs(speeds, around))


def _differs(speeds: Floats, others: Floats) -> Mask:
    return np.asarray(np.abs(speeds - others) > np.maximum(OFF_MPS, OFF_SHARE * others))
