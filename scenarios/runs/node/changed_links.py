"""The incoming links of one vehicle, and what is changed of them while it drives."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True)
class ChangingLink:
    """One link, what is asked of it, and what makes its effects when it is another one."""

    link: Link
    asked: LinkTable
    effects_of: EffectsOf


class ChangedLinks:
    """What is changed of the links to one vehicle of a convoy of `names`.

    What the `scheduled` changes do a link knows beforehand; by hand is added when it is due. All of
    it belongs to the channel: it outlives the vehicle's software, whose links are made anew.
    """

    def __init__(
        self, names: Sequence[str], scheduled: Iterable[Due], by_hand: Iterable[Due] = ()
    ) -> None:
        """`scheduled` are the changes of the scenario, `by_hand` those carried out before."""
        self._names = names
        self._links: dict[tuple[str, str], ChangingLink] = {}
        self._by_hand = list(by_hand)
        self._changes = [
            (due.at, due.change)
            for due in (*scheduled, *self._by_hand)
            if isinstance(due.change, LINK_CHANGES)
        ]

    @property
    def by_hand(self) -> tuple[Due, ...]:
        """What was done by hand so far, in the order in which it was carried out."""
        return tuple(self._by_hand)

    def adopt(self, links: Iterable[ChangingLink]) -> None:
        """Change these links, in the place of those before."""
        self._links = {(one.link.sender, one.link.receiver): one for one in links}
        if self._changes:
            self._set_courses(self._links)

    def carry_out(self, due: Due) -> str:
        """Carry out what is due, if it is about links; returns what there is to say of it."""
        if not isinstance(due.change, LINK_CHANGES):
            return ""
        about = links_of(due.change, self._names, self._links)
        if due.by_hand:
            self._by_hand.append(due)
            self._changes.append((due.at, due.change))
            self._set_courses(about)
        links = ", ".join(f"{sender} → {receiver}" for sender, receiver in about)
        return f"{links}: {in_words(due.change)}{', by hand' if due.by_hand else ''}"

    def _set_courses(self, about: Iterable[tuple[str, str]]) -> None:
        """Work out anew what becomes of some links."""
        self._changes.sort(key=_at)
        for pair in about:
            one = self._links[pair]
            mine = [two for two in self._changes if links_of(two[1], self._names, [pair])]
            one.link.course = course(mine, one.asked, one.effects_of)


def _at(one: tuple[int, LinkChange]) -> int:
    return one[0]
