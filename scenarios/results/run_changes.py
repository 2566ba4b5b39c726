"""Changes to a running convoy, scheduled or by hand, as the summary lists them."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field

from scenarios.definition.changing.link_changes import LINK_CHANGES
from scenarios.definition.changing.live_change import change_from_json
from scenarios.definition.errors import ScenarioError
from vehicles.messages import Change

MOST_CHANGES = 1000
"""Changes listed in the summary; the log has them all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunChange:
    """A change that was carried out."""

    at_s: float
    """Time from which the change holds."""
    kind: str
    """Kind of [[change]]: link, cut, heal, gnss, stall, crash, join, leave or speed."""
    target: str
    """Vehicle that changed, or sender → receiver of the changed links (*: any); empty for the
    convoy."""
    for_s: float | None
    """Duration; null if the change has no end of its own."""
    by_hand: bool
    """Whether the change was made by hand rather than by the scenario."""
    vehicles: tuple[str, ...]
    """Vehicles that carried the change out."""


@dataclass(slots=True)
class ChangeLog:
    """Gathers changes; equal ones of several vehicles at one instant are one change."""

    _by: dict[tuple[int, str], list[Change]] = field(default_factory=dict)

    def add(self, change: Change) -> None:
        key = change.effective_at_ns, change.table
        if key in self._by or len(self._by) < MOST_CHANGES:
            self._by.setdefault(key, []).append(change)

    def changes(self, seconds: Callable[[int], float]) -> tuple[RunChange, ...]:
        """List the changes in order of time; `seconds` converts an instant (ns)."""
        return tuple(
            _run_change(same, seconds(at))
            for (at, _), same in sorted(self._by.items(), key=lambda entry: entry[0])
        )


def _run_change(same: list[Change], at_s: float) -> RunChange:
    first = same[0]
    target, for_s = "", None
    with suppress(ScenarioError):  # of a later version
        change = change_from_json(first.table)
        for_s = getattr(change, "for_s", None)
        target = getattr(change, "vehicle", "")
        if isinstance(change, LINK_CHANGES):
            target = f"{change.sender} → {change.receiver}"
    return RunChange(
        at_s=at_s,
        kind=first.kind,
        target=target,
        for_s=for_s,
        by_hand=first.by_hand,
        vehicles=tuple(dict.fromkeys(change.vehicle for change in same)),
    )
