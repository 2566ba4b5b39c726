"""Outliers among the samples of a fit.

The gates check poses one by one before they become samples. They accept a jump of decimetres if the
receiver's noise explains it, but such a jump would displace the curve.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_sum = np.add.reduce

JUMP_SHARE: Final = 0.25  # Removing a jump lowers the squared residuals by more than this
MAX_JUMPS: Final = 3  # Number of samples that are removed one by one
MIN_KEPT_SHARE: Final = 0.6  # Share of the samples that must remain
FAR_RATIO: Final = 4.0  # Ratio to the median distance beyond which a sample is far from the curve


def without_jumps(
    east: Floats, north: Floats, station: Floats, offsets: Floats, tolerance: float
) -> NDArray[np.bool_] | None:
    """Select the samples to keep (True) when some `offsets` from a fit exceed `tolerance` (m).

    None if no sample stands out. A jump displaces the curve, so the jumped sample need not be the
    one furthest off. Samples are therefore removed one by one, each time the one without which an
    arc fits the rest best (deletion by leverage, Cook and Weisberg, 1982). If this removes none, a
    whole stretch may have jumped: then all samples far off compared with the median are removed.
    """
    keep = np.ones(len(east), dtype=np.bool_)
    for _ in range(MAX_JUMPS):
        worst = _worst(east[keep], north[keep], station[keep])
        if worst is None:
            break
        keep[np.flatnonzero(keep)[worst]] = False
    if not keep.all():
        return keep
    size = np.abs(offsets)
    near = size <= max(tolerance, FAR_RATIO * float(np.sort(size)[len(size) // 2]))
    kept = int(np.count_nonzero(near))
    return near if max(3.0, MIN_KEPT_SHARE * len(size)) <= kept < len(size) else None


def _worst(east: Floats, north: Floats, station: Floats) -> int | None:
    """Index of the sample without which an arc fits much better; None if there is none.

    Removing sample i from a linear fit lowers the sum of squared residuals by r_i²/(1 − h_i), where
    h_i is its leverage (the diagonal of the hat matrix). The arc is linear in offset, slope and
    curvature along the line of least squares (`fit_arc`).
    """
    along = station - float(_sum(station)) / len(station)
    if len(station) < 5:
        return None
    ux, uy = float(_sum(along * east)), float(_sum(along * north))
    norm = (ux * ux + uy * uy) ** 0.5
    if not 0.0 < norm < np.inf:
        return None
    dx, dy = east - east[0], north - north[0]
    x, y = (dx * ux + dy * uy) / norm, (dy * ux - dx * uy) / norm
    x, y = x - float(_sum(x)) / len(x), y - float(_sum(y)) / len(y)
    square = x * x
    curved = (
        square - float(_sum(square)) / len(x) - float(_sum(square * x)) / float(_sum(square)) * x
    )
    spread = float(_sum(curved * curved))
    if not spread > 0.0:
        return None
    rest = y - float(_sum(x * y)) / float(_sum(square)) * x
    rest = rest - float(_sum(curved * rest)) / spread * curved
    leverage = 1.0 / len(x) + square / float(_sum(square)) + curved * curved / spread
    gain = rest * rest / np.maximum(1.0 - leverage, 1e-9)
    worst = int(gain.argmax())
    return worst if float(gain[worst]) > JUMP_SHARE * float(_sum(rest * rest)) else None
