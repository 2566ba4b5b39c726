"""What a scenario file may say of the directed links between vehicles."""

from typing import Annotated

from pydantic import Field

from scenarios.definition.schema.base_table import Ratio, Table
from transport.links.laws.content import ContentLaw
from transport.links.laws.loss.collisions import Collisions
from transport.links.laws.queue import Queue
from transport.links.laws.registry import DelayLaw, LossLaw, OutageLaw, RadioLaw


class LinkTable(Table):
    """What a directed link does to messages.

    latency_ms    least delay from sending to reception, the floor that the wire has to beat
    jitter_ms     further delay, uniform between 0 and this
    loss_ratio    share of messages lost, each on its own (Bernoulli)
    rate_hz       messages a second that the link carries; left out, it carries every message
    loss          another law of loss besides: in bursts, by number, as recorded
    collisions    loss of whole reservations besides
    content       copies, messages held back, wrong bits and false content
    delay         further delay by a law, and whether messages keep their order
    queue         bytes a second that the sender sends, and how many messages wait
    outages       times and places at which nothing is carried
    radio         what is received over the true distance, with loss on the way and obstruction
    preset        a shipped channel, laid under the other keys when a scenario is read
    preset_source  where its figures are from, which says that this has been done
    """

    preset: str | None = None
    preset_source: str | None = None

    latency_ms: float = Field(default=20.0, ge=0, le=60_000)
    jitter_ms: float = Field(default=0.0, ge=0, le=60_000)
    loss_ratio: Ratio = 0.0
    rate_hz: float | None = Field(default=None, ge=0.01, le=1000)
    loss: LossLaw | None = None
    collisions: Collisions | None = None
    content: ContentLaw | None = None
    delay: DelayLaw | None = None
    queue: Queue | None = None
    outages: Annotated[tuple[OutageLaw, ...], Field(strict=False)] | None = None
    radio: RadioLaw | None = None

    @property
    def is_lossless(self) -> bool:
        """Whether it carries every message, by nothing but latency and jitter."""
        asked = {key for key, value in self if value != LinkTable.model_fields[key].default}
        return asked <= {"latency_ms", "jitter_ms", "preset", "preset_source"}


class LinkEntry(LinkTable):
    """Other values for the link from `sender` to `receiver`.

    Each end is a vehicle's name, a role ("lead", "predecessor", "follower"), or "*" for any. With a
    preset it takes nothing from the convoy's values: a preset is a whole channel.
    """

    sender: str
    receiver: str
