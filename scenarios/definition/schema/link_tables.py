"""Tables of the directed links between vehicles."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from scenarios.definition.schema.plug_ins.points import DELAY, LOSS
from scenarios.definition.schema.plug_ins.table import plug_in
from scenarios.definition.schema.settings_table import Name, Ratio, Table
from transport.links.laws.basic import Queue
from transport.links.laws.content import ContentLaw
from transport.links.laws.delays import BaseDelay
from transport.links.laws.link_law import LinkLaw
from transport.links.laws.registry import DelayLaw, LossLaw, OutageLaw, RadioLaw
from transport.links.laws.shared_channel import Collisions

if TYPE_CHECKING:
    LossPlugIn = LinkLaw
    DelayPlugIn = BaseDelay
else:
    LossPlugIn, DelayPlugIn = plug_in(LOSS, LossLaw), plug_in(DELAY, DelayLaw)


class LinkTable(Table):
    """Impairments of a directed link.

    latency_ms     smallest delay from sending to reception; the real transport must be faster
    jitter_ms      additional uniform delay, from 0 to this
    loss_ratio     independent loss (Bernoulli)
    rate_hz        messages per second that the link carries; omitted: no limit
    loss           an additional law of loss: bursts, numbered messages, a recording
    collisions     additional loss of complete reservations
    content        duplicates, reordering, bit errors and false content
    delay          an additional law of delay, and the order of messages
    queue          bytes per second that the sender can send, and the length of its queue
    outages        times and places without reception
    radio          reception over the true distance, with path loss and obstruction
    preset         a shipped channel; other keys replace its values
    preset_source  source of the preset's figures, written by the program; do not set
    """

    preset: str | None = None
    preset_source: str | None = None

    latency_ms: float = Field(default=20.0, ge=0, le=60_000)
    jitter_ms: float = Field(default=0.0, ge=0, le=60_000)
    loss_ratio: Ratio = 0.0
    rate_hz: float | None = Field(default=None, ge=0.01, le=1000)
    loss: LossPlugIn | None = None
    collisions: Collisions | None = None
    content: ContentLaw | None = None
    delay: DelayPlugIn | None = None
    queue: Queue | None = None
    outages: Annotated[tuple[OutageLaw, ...], Field(strict=False)] | None = None
    radio: RadioLaw | None = None

    @property
    def is_lossless(self) -> bool:
        """Whether the link only delays messages, by latency and jitter."""
        given = {key for key, value in self if value != LinkTable.model_fields[key].default}
        return given <= {"latency_ms", "jitter_ms", "preset", "preset_source"}


class LinkEntry(LinkTable):
    """Other values for the links from `sender` to `receiver`.

    With a preset the values of [links] do not apply, since a preset is a complete channel.

    sender    a vehicle, a role ("lead", "predecessor", "follower"), or "*" for any vehicle
    receiver  likewise
    """

    sender: str
    receiver: str


# ---- Information flow: the vehicles whose poses a follower uses, for either direction of control


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
    follower must receive its predecessor, for which it brakes.

    lateral       vehicles ahead, through whose poses it steers
    longitudinal  vehicles that its longitudinal controller uses. "consensus" uses any; the others
                  use the predecessor, and the lead if it is one of them
    """

    lateral: SourcesOf = USUAL
    longitudinal: SourcesOf = USUAL
