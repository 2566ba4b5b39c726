"""What a scenario file may say of how a directed link loses messages, besides `loss_ratio`.

Every key but `kind` may be left out, for an entry about one link may give some and inherit the
others; what is missing in the end is refused by `scenarios.definition.channel.loss`.
"""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from scenarios.definition.schema.table import Ratio, Table

MessageNumber = Annotated[int, Field(ge=0, le=10**12)]
MessageCount = Annotated[int, Field(ge=1, le=10**9)]
FileName = Annotated[str, StringConstraints(min_length=1)]
AfterRecord = Literal["repeat", "pass"]


class NoLoss(Table):
    """No further loss, where others have some."""

    kind: Literal["none"]


class GilbertElliottLoss(Table):
    """A good and a bad state of the link: by its chances, or by mean loss and mean burst.

    good_to_bad_ratio     p, chance of the link turning bad before a message
    bad_to_good_ratio     r, chance of its turning good
    bad_delivered_ratio   h, share of messages delivered in the bad state
    good_delivered_ratio  k, share delivered in the good state
    loss_ratio            in place of them: mean loss ...
    burst_messages_mean   ... and mean number lost in a row (with h = 0, k = 1)
    """

    kind: Literal["gilbert_elliott"]
    good_to_bad_ratio: Ratio | None = None
    bad_to_good_ratio: Ratio | None = None
    bad_delivered_ratio: Ratio | None = None
    good_delivered_ratio: Ratio | None = None
    loss_ratio: Ratio | None = None
    burst_messages_mean: float | None = Field(default=None, ge=1, le=10_000)


class FourStateLoss(Table):
    """The four states of netem: sent in a gap 1, sent in a burst 2, lost in it 3, lost alone 4.

    gap_to_burst_ratio   p13, chance of a burst to begin with the message
    burst_to_gap_ratio   p31, chance of it to end after a loss
    lost_to_sent_ratio   p32, chance of a message sent after a loss, within the burst
    sent_to_lost_ratio   p23, chance of a loss after such a message
    isolated_loss_ratio  p14, chance of a loss alone, in the gap
    """

    kind: Literal["four_state"]
    gap_to_burst_ratio: Ratio | None = None
    burst_to_gap_ratio: Ratio | None = None
    lost_to_sent_ratio: Ratio = 0.0
    sent_to_lost_ratio: Ratio = 1.0
    isolated_loss_ratio: Ratio = 0.0


class EveryNthLoss(Table):
    """Message `first_number` is lost, and from then on one of every `every_messages`."""

    kind: Literal["every_nth"]
    every_messages: MessageCount | None = None
    first_number: MessageNumber = 0


class ListedLoss(Table):
    """Messages with certain numbers are lost: a text such as "3, 7, 10-20"."""

    kind: Literal["listed"]
    lost_numbers: str | None = None


class PatternLoss(Table):
    """A recorded pattern: CSV with the columns number and received, 0 or 1.

    Its first line is the first message of the run. Beyond its end it begins again, or lets all
    messages pass. When the file has been read, the pattern is `length_messages` long, lost the
    `lost_numbers` and is from `source`.
    """

    kind: Literal["pattern"]
    file: FileName | None = None
    after_end: AfterRecord = "repeat"
    source: str = ""
    length_messages: MessageCount | None = None
    lost_numbers: str | None = None


class LogLoss(Table):
    """What became of the messages of an earlier run: the same channel again, loss and delay.

    Of the log it is the link from `sender` to `receiver`, by default the one of the same names.
    The record takes the place of all other keys of the link; only messages beyond its end have
    `latency_ms`, unless it begins again. When the file has been read, `delays_ns` are the delays
    in order, such as "20000000x700, 23000000", and `dropped_numbers` those dropped, by reason.
    """

    kind: Literal["log"]
    file: FileName | None = None
    sender: str | None = None
    receiver: str | None = None
    after_end: AfterRecord = "repeat"
    source: str = ""
    delays_ns: str | None = None
    dropped_numbers: dict[str, str] = Field(default_factory=dict)


LossTable = Annotated[
    NoLoss | GilbertElliottLoss | FourStateLoss | EveryNthLoss | ListedLoss | PatternLoss | LogLoss,
    Field(discriminator="kind"),
]


class CollisionsTable(Table):
    """Persistent collisions of LTE-V2X mode 4.

    loss_ratio                  share of messages lost; all of a reservation or none
    keep_ratio                  chance of a resource to be kept at reselection: 0 to 0.8
    reselection_messages_min    messages of a reservation, uniform between these: 5 to 15 at
    reselection_messages_max    100 ms, 10 to 30 at 50 ms, 25 to 75 at 20 ms
    """

    loss_ratio: Ratio | None = None
    keep_ratio: float = Field(default=0.0, ge=0, le=0.99)
    reselection_messages_min: int = Field(default=5, ge=1, le=1000)
    reselection_messages_max: int = Field(default=15, ge=1, le=1000)
