"""The samples of one source with their weight, as a fusion receives them."""

from typing import Final, NamedTuple

from vehicles.preview.received.samples import Window

LEAD: Final = 0
PREDECESSOR: Final = 1


class SourceWindow(NamedTuple):
    """Samples of one source around the ego, and its weight in the trajectory.

    `place` is 0 for the lead, else k for the k-th vehicle ahead: 1 for the predecessor. The weights
    of all sources add up to 1.
    """

    place: int
    weight: float
    window: Window
