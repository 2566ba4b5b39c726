"""Changes of the incoming links of one vehicle."""

from bisect import insort
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from operator import itemgetter

from scenarios.definition.changing.link_changes import (
    LINK_CHANGES,
    EffectsOf,
    LinkChange,
    Made,
    course,
    links_of,
)
from scenarios.definition.changing.live_change import describe_change
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.runs.node.pending_changes import DueChange
from transport.links.link import Link


@dataclass(slots=True)
class ChangingLink:
    """One link with its requested settings and its changes by instant (ns), in order of time."""

    link: Link
    requested: LinkTable
    effects_of: EffectsOf
    changes: list[tuple[int, LinkChange]] = field(default_factory=list)
    made: Made = field(default_factory=dict)

    def change(self, at: int, change: LinkChange) -> None:
        """Change the link from the instant `at` (ns) on; earlier effects stay."""
        insort(self.changes, (at, change), key=itemgetter(0))
        before = [changed for changed in self.link.changes if changed.from_at < at]
        after = course(self.changes, self.requested, self.effects_of, since=at, made=self.made)
        self.link.changes = (*before, *after)


class ChangedLinks:
    """Changes of the links to one vehicle of a convoy of `names`.

    A link knows the `scheduled` changes beforehand; those by hand are added when they are due.
    Changes belong to the channel: they outlive the vehicle's software, which builds its links
    again.
    """

    def __init__(
        self,
        names: Sequence[str],
        scheduled: Iterable[DueChange],
        by_hand: Iterable[DueChange] = (),
    ) -> None:
        self._names = names
        self._links: dict[tuple[str, str], ChangingLink] = {}
        self._scheduled = list(scheduled)
        self._by_hand = list(by_hand)

    @property
    def by_hand(self) -> tuple[DueChange, ...]:
        return tuple(self._by_hand)

    def adopt(self, links: Iterable[ChangingLink]) -> None:
        """Replace the links and apply all changes so far to the new ones."""
        self._links = {
            (changing.link.sender, changing.link.receiver): changing for changing in links
        }
        for due in (*self._scheduled, *self._by_hand):
            self._change(due)

    def carry_out(self, due: DueChange) -> str:
        """Carry out a change of links; returns a line for the log, empty for other changes."""
        if not isinstance(due.change, LINK_CHANGES):
            return ""
        if due.by_hand:
            self._by_hand.append(due)
            self._change(due)
        about = links_of(due.change, self._names, self._links)
        links = ", ".join(f"{sender} → {receiver}" for sender, receiver in about)
        return f"{links}: {describe_change(due.change)}{', by hand' if due.by_hand else ''}"

    def _change(self, due: DueChange) -> None:
        if isinstance(due.change, LINK_CHANGES):
            for pair in links_of(due.change, self._names, self._links):
                self._links[pair].change(due.at, due.change)
