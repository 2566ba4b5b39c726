"""Information flow: the vehicles whose poses a follower uses, for either direction of control."""

from collections.abc import Mapping, Sequence
from typing import Annotated

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from scenarios.definition.schema.base_table import Name, Table

WORD_ERROR = "unknown_word"
"""Type of the validation error of a value that is none of some words, nor anything else allowed."""
MOST = 200
"""Largest number of vehicles on either side, that of a convoy."""


class SourcesTable(Table):
    """Vehicles whose poses a follower uses.

    ahead   number of vehicles directly ahead
    behind  number of vehicles directly behind, for the longitudinal controller only
    lead    whether the lead is one of them
    names   names of further vehicles
    """

    ahead: int = Field(default=0, ge=0, le=MOST)
    behind: int = Field(default=0, ge=0, le=MOST)
    lead: bool = False
    names: Annotated[tuple[Name, ...], Field(strict=False)] = ()

    def of(self, names: Sequence[str], place: int) -> tuple[str, ...]:
        """Vehicles of the convoy `names` that the one at `place` uses, from front to back."""
        near = range(max(place - self.ahead, 0), place + self.behind + 1)
        return tuple(
            name
            for other, name in enumerate(names)
            if name in self.names
            or (other != place and (other in near or (self.lead and not other)))
        )

    @property
    def word(self) -> str:
        """The word for these sources, empty if there is none."""
        return next((word for word, table in WORDS.items() if table == self), "")

    def describe(self) -> str:
        if self.word:
            return self.word.replace("_", " ")
        parts = [
            f"{count} {side}" for side in ("ahead", "behind") if (count := getattr(self, side))
        ]
        return ", ".join([*["lead"] * self.lead, *parts, *self.names]) or "none"


WORDS: Mapping[str, SourcesTable] = {
    "predecessor": SourcesTable(ahead=1),
    "lead": SourcesTable(lead=True),
    "lead_and_predecessor": SourcesTable(ahead=1, lead=True),
    "bidirectional": SourcesTable(ahead=1, behind=1),
    "all_ahead": SourcesTable(ahead=MOST),
    "all": SourcesTable(ahead=MOST, behind=MOST),
}
"""Usual information flows by their words."""
USUAL = WORDS["lead_and_predecessor"]


def _sources(given: object) -> object:
    """Convert a word or a list of names to its table."""
    if isinstance(given, str) and given in WORDS:
        return WORDS[given]
    if isinstance(given, list | tuple):
        return {"names": given}
    if isinstance(given, Mapping | SourcesTable):
        return given
    raise PydanticCustomError(
        WORD_ERROR,
        "{or_else}",
        {"words": list(WORDS), "or_else": "a list of vehicles, or a table such as { ahead = 2 }"},
    )


SourcesOf = Annotated[SourcesTable, BeforeValidator(_sources)]


class InformationFlowTable(Table):
    """Information flow: the vehicles whose poses each follower uses.

    Each key is "predecessor", "lead", "lead_and_predecessor", "bidirectional" (the vehicles
    directly ahead and behind), "all_ahead", "all", a list of vehicles, or a table such as
    { ahead = 2 }. A follower receives the vehicles of both keys, and no others.
    [vehicle.NAME.information_flow] has the same keys for one vehicle. With reaction "degrade" a
    follower must receive its predecessor, to which it keeps the safe distance.

    lateral       vehicles ahead, through whose poses it steers
    longitudinal  vehicles that its longitudinal controller uses. "consensus" uses any; the others
                  use the predecessor, and the lead if it is one of them
    """

    lateral: SourcesOf = USUAL
    longitudinal: SourcesOf = USUAL
