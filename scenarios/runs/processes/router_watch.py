"""How long the router has been out of reach, for recorder and vehicles."""

from vehicles.schedule import SECOND

ROUTER_LOST_AFTER_NS = 5 * SECOND
"""The run is over when the router has been out of reach for this long."""


class RouterWatch:
    """Tracks whether the router is in reach; instants are ns."""

    def __init__(self) -> None:
        self.lost_at: int | None = None
        self.back_at = 0

    def look(self, now: int, *, connected: bool) -> int:
        """Note whether the router is in reach; returns the length (ns) of an ended outage."""
        if not connected:
            self.lost_at = self.lost_at or now
            return 0
        if self.lost_at is None:
            return 0
        outage, self.lost_at, self.back_at = now - self.lost_at, None, now
        return outage

    def is_lost_for_good(self, now: int) -> bool:
        return self.lost_at is not None and now - self.lost_at > ROUTER_LOST_AFTER_NS
