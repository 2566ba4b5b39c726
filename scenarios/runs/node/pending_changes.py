"""Pending changes of one vehicle, by its scenario and by hand."""

from bisect import insort
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import attrgetter
from threading import Lock

from scenarios.definition.schema.change_tables import AnyChange
from vehicles.schedule import nanoseconds


@dataclass(frozen=True, slots=True)
class DueChange:
    """A change that takes effect at the instant `at` (ns), by a scenario or by hand."""

    at: int
    change: AnyChange
    by_hand: bool = False


_at = attrgetter("at")


class PendingChanges:
    """Pending changes of one vehicle, in order of time and then of addition.

    Any thread may add; only the vehicle's thread takes.
    """

    def __init__(self, scheduled_changes: Iterable[DueChange] = ()) -> None:
        self._coming = sorted(scheduled_changes, key=_at)
        self._lock = Lock()

    def add(self, due: DueChange) -> None:
        with self._lock:
            insort(self._coming, due, key=_at)

    @property
    def pending(self) -> tuple[DueChange, ...]:
        with self._lock:
            return tuple(self._coming)

    def take(self, now: int) -> list[DueChange]:
        """Remove and return the changes that are due at the tick at `now` (ns)."""
        if not self._coming or self._coming[0].at > now:  # the usual tick needs no lock
            return []
        with self._lock:
            count = sum([due.at <= now for due in self._coming])
            taken, self._coming = self._coming[:count], self._coming[count:]
        return taken


def scheduled_changes(
    changes: Iterable[AnyChange], start_at: int, concerns: Callable[[AnyChange], bool]
) -> list[DueChange]:
    """Changes of a scenario that concern a vehicle, for a run from `start_at` (ns)."""
    return [
        DueChange(start_at + nanoseconds(change.at_s), change)
        for change in changes
        if concerns(change)
    ]
