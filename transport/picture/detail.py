"""Level of detail of a long convoy: all of a few vehicles, and the places of the others.

More curves cannot be distinguished, and drawing all of them takes longer than the convoy drives.
"""

from collections.abc import Sequence

MAX_ALL_DETAILED = 12
"""Largest convoy of which all vehicles are drawn in detail."""
DETAILED = 8
"""Number of vehicles of a longer one that are drawn in detail."""
SHOWN_ABOUT = 5
"""Vehicles of a longer one that the moving view shows before and behind the followed one."""


class Detail:
    """Vehicles that are drawn in detail, of those of a convoy, lead first.

    `names` are evenly spread over the convoy, with its first and last; `followed` is the one of
    them that the moving view follows.
    """

    def __init__(self, vehicles: Sequence[str]) -> None:
        last = len(vehicles) - 1
        self.is_all = len(vehicles) <= MAX_ALL_DETAILED
        places = [round(k * last / (DETAILED - 1)) for k in range(DETAILED)]
        self.names = tuple(vehicles) if self.is_all else tuple(vehicles[one] for one in places)
        self.followed = self.names[len(self.names) // 2]
        self._vehicles = tuple(vehicles)
        self._named = frozenset(self.names)
        self._period_factor = 1.0 if self.is_all else len(vehicles) / DETAILED

    def __contains__(self, vehicle: str) -> bool:
        return self.is_all or vehicle in self._named

    @property
    def shown(self) -> int:
        """Number of vehicles in the moving view."""
        return len(self._vehicles) if self.is_all else 2 * SHOWN_ABOUT + 1

    def shows(self, place: int, followed: int) -> bool:
        """Whether the moving view shows the vehicle at a place, with the place it follows."""
        return self.is_all or abs(place - followed) <= SHOWN_ABOUT

    def period(self, period_ns: int) -> int:
        """Time (ns) between two drawings of a vehicle; longer in a long convoy."""
        return round(period_ns * self._period_factor)
