"""How long the router has been out of reach, for recorder and vehicles."""

from vehicles.schedule import SECOND

ROUTER_LOST_AFTER_NS = 5 * SECOND
"""The run is over when the router has been out of reach for this long."""
LAST_MOMENT_NS = SECOND
"""A run whose router was lost for good no earlier before its end than this is completed."""


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

    def was_lost_before(self, end_at: int) -> bool:
        """Whether it was lost before `end_at`: the last messages did not reach the recorder."""
        return self.lost_at is not None and self.lost_at < end_at

    def was_lost_near_end(self, end_at: int) -> bool:
        """Whether it was lost so late that a run until `end_at` counts as completed."""
        return self.lost_at is not None and self.lost_at >= end_at - LAST_MOMENT_NS
