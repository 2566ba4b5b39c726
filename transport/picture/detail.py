"""Level of detail of a long convoy: all data of a few vehicles, and the positions of the others.

More curves cannot be distinguished, and drawing them all would be slower than real time.
"""

from collections.abc import Sequence

MAX_ALL_DETAILED = 12  # Largest convoy of which all vehicles are drawn in detail
DETAILED = 8  # Number of vehicles of a longer convoy that are drawn in detail
SHOWN_ABOUT = 5  # Vehicles shown ahead of and behind the followed one


class Detail:
    """Vehicles of a convoy that are drawn in detail, lead first.

    `names` are evenly spread over the convoy and include its first and last vehicle. The moving
    view follows `followed`.
    """

    def __init__(self, vehicles: Sequence[str]) -> None:
        last = len(vehicles) - 1
        self.is_all = len(vehicles) <= MAX_ALL_DETAILED
        places = [round(k * last / (DETAILED - 1)) for k in range(DETAILED)]
        self.names = tuple(vehicles) if self.is_all else tuple(vehicles[place] for place in places)
        self.followed = self.names[len(self.names) // 2]
        self._vehicles = tuple(vehicles)
        self._named = frozenset(self.names)
        self._period_factor = 1.0 if self.is_all else len(vehicles) / DETAILED

    def __contains__(self, vehicle: str) -> bool:
        return self.is_all or vehicle in self._named

    @property
    def shown(self) -> int:
        return len(self._vehicles) if self.is_all else 2 * SHOWN_ABOUT + 1

    def shows(self, place: int, followed: int) -> bool:
        return self.is_all or abs(place - followed) <= SHOWN_ABOUT

    def period(self, period_ns: int) -> int:
        return round(period_ns * self._period_factor)  # ns
