"""What linear theory says a convoy does behind a given lead: no sampling, no fit, no noise."""

import numpy as np
from numpy.typing import NDArray

from scenarios.results.drives import Drive
from vehicles.theory.string_stability import Transfer

Array = NDArray[np.float64]

SAMPLES = 4096
"""Points over which the lead's path is laid out; a power of two."""


def predicted(
    lead: Drive, transfer: Transfer, alpha: float, followers: int
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Largest tracking and true cross-track errors (m) of each follower.

    The lead drives east at constant speed and ends on the line on which it began. Follower i
    answers its reference r_i = α y_(i−1) + (1 − α) y_0 with y_i = F r_i (`transfer`), so its error
    against its own trajectory is y_i − r_i, and against the lead's path y_i − y_0.
    """
    span = float(lead.at[-1] - lead.at[0])
    times = np.linspace(0.0, span, SAMPLES, endpoint=False)
    east = lead.east[0] + (lead.east[-1] - lead.east[0]) * times / span
    path = np.fft.rfft(np.interp(east, lead.east, lead.north))
    frequencies: Array = 2.0 * np.pi / span * np.arange(SAMPLES // 2 + 1, dtype=np.float64)
    factor = transfer.at(frequencies)
    own, tracking, cross_track = path, [], []
    for _ in range(followers):
        reference = alpha * own + (1.0 - alpha) * path
        own = factor * reference
        tracking.append(float(np.abs(np.fft.irfft(own - reference)).max()))
        cross_track.append(float(np.abs(np.fft.irfft(own - path)).max()))
    return tuple(tracking), tuple(cross_track)
