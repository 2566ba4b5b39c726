"""Tables of the directed links between vehicles."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from scenarios.definition.schema.base_table import Ratio, Table
from scenarios.definition.schema.plug_ins.channel import DELAY, LOSS
from scenarios.definition.schema.plug_ins.table import plug_in
from transport.links.laws.content import ContentLaw
from transport.links.laws.delay.base import BaseDelay
from transport.links.laws.link_law import LinkLaw
from transport.links.laws.loss.collisions import Collisions
from transport.links.laws.queue import Queue
from transport.links.laws.registry import DelayLaw, LossLaw, OutageLaw, RadioLaw

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
