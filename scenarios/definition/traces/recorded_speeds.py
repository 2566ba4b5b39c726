"""Recorded speeds of a drive that agree with its positions."""

import numpy as np

from scenarios.definition.traces.recorded_drive import FASTEST, Floats, Mask

WINDOW = 2.0
"""Time (s) over which positions give a speed."""

MOST_OFF = 10.0
"""Largest difference (m/s) of a recorded speed from its neighbours and from the positions..."""

MOST_OFF_SHARE = 0.5
"""...or this share of their speed, if that is more."""

LONGEST_RUN = 5.0
"""Longest time (s) of a single wrong value; longer ones are no slips."""

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
    known = np.flatnonzero(np.isfinite(speed_mps))
    if 2 * known.size <= points.shape[1]:
        return None, ()
    last = np.maximum(np.searchsorted(known, np.arange(points.shape[1]), side="right") - 1, 0)
    speeds = np.abs(speed_mps[known[last]])
    instead = "speeds follow from the times" if time_s.size else "speeds are ignored"
    if not speeds.any():
        return None, (f"every recorded speed is 0 while the position changes: {instead}",)
    derived = _derived(time_s, points) if time_s.size else np.full(speeds.size, np.nan)
    ratio = _median_ratio(speeds, derived)
    absurd = speeds > FASTEST
    if RATIOS[0] <= ratio <= RATIOS[1]:
        if 2 * np.count_nonzero(absurd) > speeds.size:
            return None, (f"most recorded speeds are above {FASTEST:g} m/s: {instead}",)
        absurd |= _slips(speeds, derived, time_s, absurd)
        at = time_s if time_s.size else np.arange(float(speeds.size))
        smooth = speeds.copy()
        smooth[absurd] = np.interp(at[absurd], at[~absurd], speeds[~absurd])
        ratio = _total_ratio(smooth, derived, time_s)
        if RATIOS[0] <= ratio <= RATIOS[1]:
            return smooth, _interpolated(absurd, speeds)
    unit = next((f" ({u}?)" for n, u in UNITS.items() if abs(ratio / n - 1.0) < SAME_UNIT), "")
    off = f"{ratio:.2f} times what the positions need{unit}"
    return None, (f"recorded speeds are {off}: {instead}",)


def _interpolated(absurd: Mask, speeds: Floats) -> tuple[str, ...]:
    count = int(np.count_nonzero(absurd))
    if not count:
        return ()
    worst = float(np.max(speeds[absurd]))
    if count == 1:
        return (f"1 recorded speed, {worst:.4g} m/s, does not fit the others: interpolated",)
    most = f"{count} recorded speeds, up to {worst:.4g} m/s, do not fit"
    return (f"{most} the others: interpolated",)


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


def _median_ratio(speeds: Floats, derived: Floats) -> float:
    """Return the median ratio of recorded speeds to those of the positions, 1 if unknown."""
    moving = derived >= MOVING
    if np.count_nonzero(moving) < 3:
        return 1.0
    return float(np.median(speeds[moving] / derived[moving]))


def _total_ratio(speeds: Floats, derived: Floats, at: Floats) -> float:
    """Return the ratio of distances by recorded speeds and by positions, 1 if unknown."""
    valid = np.isfinite(derived) & (derived < FASTEST)
    if np.count_nonzero(valid & (derived >= MOVING)) < 3:
        return 1.0
    gone = np.gradient(at)[valid]
    return float(np.sum(gone * speeds[valid]) / np.sum(gone * derived[valid]))


def _slips(speeds: Floats, derived: Floats, at: Floats, absurd: Mask) -> Mask:
    """Mark short runs of speeds that fit neither the positions nor the speeds around the run."""
    off = absurd | _differs(speeds, derived)
    edges = np.diff(np.concatenate(([False], off, [False])).astype(np.int8))
    begin, end = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    if off.all() or not begin.size or not at.size:
        return absurd
    short = at[end] - at[begin] <= LONGEST_RUN
    marks = np.zeros(off.size + 1, dtype=np.int64)
    np.add.at(marks, begin[short], 1)
    np.add.at(marks, end[short] + 1, -1)
    in_short = np.cumsum(marks)[:-1] > 0
    around = np.interp(at, at[~off], speeds[~off])
    return np.asarray(in_short & _differs(speeds, around))


def _differs(speeds: Floats, others: Floats) -> Mask:
    limit = np.maximum(MOST_OFF, MOST_OFF_SHARE * others)
    return np.asarray(np.abs(speeds - others) > limit)  # False for NaN
