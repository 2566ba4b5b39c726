"""The incoming links of one vehicle, and what is changed of them while it drives."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import itemgetter

from scenarios.definition.changing.asked import in_words
from scenarios.definition.changing.links import (
    LINK_CHANGES,
    EffectsOf,
    LinkChange,
    course,
    links_of,
)
from scenarios.definition.schema.links import LinkTable
from scenarios.runs.node.agenda import Due
from transport.links.link import Link


@dataclass(slots=True)
class ChangingLink:
    """One link, what is asked of it, and the changes about it with their instants (ns)."""

    link: Link
    asked: LinkTable
    effects_of: EffectsOf
    changes: list[tuple[int, LinkChange]] = field(default_factory=list)

    def change(self, at: int, change: LinkChange) -> None:
        """Let the link be changed from instant `at` (ns) on."""
        self.changes.append((at, change))
        self.changes.sort(key=itemgetter(0))
        self.link.course = course(self.changes, self.asked, self.effects_of)


class ChangedLinks:
    """All links to one vehicle of a convoy of `names`."""

    def __init__(self, names: Sequence[str], links: Sequence[ChangingLink]) -> None:
        self._names = names
        self._links = {(one.link.sender, one.link.receiver): one for one in links}

    def schedule(self, changes: Sequence[Due]) -> None:
        """Take what the scenario changes: links know it beforehand, for messages that come early.

        Nothing is said of it before it is due.
        """
        for due in changes:
            self._change(due)

    def carry_out(self, due: Due) -> list[str]:
        """Carry out what is due; returns what there is to say of it, a line for each link."""
        if not isinstance(due.change, LINK_CHANGES):
            return []
        if due.by_hand:
            self._change(due)
        about = links_of(due.change, self._names, self._links)
        return [f"link {sender} → {to}: {in_words(due.change)}" for sender, to in about]

    def _change(self, due: Due) -> None:
        if isinstance(due.change, LINK_CHANGES):
            for pair in links_of(due.change, self._names, self._links):
                self._links[pair].change(due.at, due.change)
