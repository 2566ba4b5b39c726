"""How much is drawn of a long convoy: all of a few vehicles, and of the others where they are.

More curves nobody tells apart, and to draw all of them takes longer than the convoy drives.
"""

from collections.abc import Sequence

MOST_WHOLE = 10
"""A convoy of more vehicles is a long one."""
DETAILED = 8
"""So many vehicles of it are drawn with all that is known of them."""
SHOWN_ABOUT = 5
"""Vehicles before and behind the followed one that the view that moves along shows of more."""


class Detail:
    """What is drawn of which vehicles.

    `names` are those drawn with everything, lead first, evenly spread over the convoy with its
    first and last; `followed` is the one of them that the view moves along with.
    """

    def __init__(self, vehicles: Sequence[str]) -> None:
        """Take the names, lead first."""
        last = len(vehicles) - 1
        self.is_all = len(vehicles) <= MOST_WHOLE
        places = [round(k * last / (DETAILED - 1)) for k in range(DETAILED)]
        self.names = tuple(vehicles) if self.is_all else tuple(vehicles[one] for one in places)
        self.followed = self.names[len(self.names) // 2]
        self._vehicles = tuple(vehicles)
        self._named = frozenset(self.names)
        self._stretch = 1.0 if self.is_all else len(vehicles) / DETAILED

    def __contains__(self, vehicle: str) -> bool:
        """Whether a vehicle is drawn with everything."""
        return self.is_all or vehicle in self._named

    @property
    def shown(self) -> int:
        """Vehicles that the view shows which moves along."""
        return len(self._vehicles) if self.is_all else 2 * SHOWN_ABOUT + 1

    def shows(self, place: int, followed: int) -> bool:
        """Whether that view shows the vehicle at a place beside the one that it follows."""
        return self.is_all or abs(place - followed) <= SHOWN_ABOUT

    def period(self, period_ns: int) -> int:
        """Time (ns) between two drawings of where a vehicle is or steers; `period_ns` if few."""
        return round(period_ns * self._stretch)
