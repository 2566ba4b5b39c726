"""What a scenario file may say of the content and the number of messages on a link."""

from typing import Annotated, Literal

from pydantic import Field

from scenarios.definition.schema.table import Ratio, Table

LATEST_S = 86_400
"""No run is longer."""

Seconds = Annotated[float, Field(ge=0, le=LATEST_S)]
Metres = Annotated[float, Field(ge=-10_000, le=10_000)]
Velocity = Annotated[float, Field(ge=-100, le=100)]


class FalseTable(Table):
    """False content, of what is sent from `from_s` on until `to_s` after the start of the run.

    Without `to_s` it lasts to the end.
    """

    from_s: Seconds = 0.0
    to_s: Seconds | None = None


class OffsetTable(FalseTable):
    """Places are told so much beside the true ones: in the plane, and along the sender's course."""

    kind: Literal["offset"]
    east_m: Metres = 0.0
    north_m: Metres = 0.0
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0


class DriftingTable(FalseTable):
    """The place told moves away from the true one, from `from_s` on."""

    kind: Literal["drift"]
    east_mps: Velocity = 0.0
    north_mps: Velocity = 0.0
    ahead_mps: Velocity = 0.0
    left_mps: Velocity = 0.0


class FrozenTable(FalseTable):
    """Messages repeat what the last one before `from_s` said, under new numbers and instants."""

    kind: Literal["frozen"]
    from_s: float = Field(gt=0, le=LATEST_S)


class ReplayedTable(FalseTable):
    """Messages repeat what was sent `age_s` earlier, under new numbers and instants."""

    kind: Literal["replayed"]
    age_s: float = Field(gt=0, le=60)


class GhostTable(FalseTable):
    """Beside each message comes one of a vehicle that is not there, in the sender's name."""

    kind: Literal["ghost"]
    ahead_m: Metres = 0.0
    left_m: Metres = 0.0


AnyFalseTable = Annotated[
    OffsetTable | DriftingTable | FrozenTable | ReplayedTable | GhostTable,
    Field(discriminator="kind"),
]


class ContentTable(Table):
    """What a link does to the content and the number of messages.

    duplicate_ratio     share of delivered messages that come twice
    duplicate_delay_ms  how much later the copy comes; left out, after a delay of its own, drawn as
                        the message's was, but never before the message
    filter_duplicates   whether the receiver refuses copies by their number, as radio stacks do
    reorder_ratio       share of messages held back, so that later ones overtake them
    reorder_delay_ms    for how long
    bit_error_ratio     probability that a bit of a frame is flipped
    frame_check         whether the receiver refuses such frames by their checksum
    false               kinds of false content, one on top of the other
    """

    duplicate_ratio: Ratio = 0.0
    duplicate_delay_ms: float | None = Field(default=None, ge=0, le=60_000)
    filter_duplicates: bool = True
    reorder_ratio: Ratio = 0.0
    reorder_delay_ms: float = Field(default=100.0, gt=0, le=60_000)
    bit_error_ratio: float = Field(default=0.0, ge=0, le=0.1)
    frame_check: bool = True
    false: Annotated[tuple[AnyFalseTable, ...], Field(strict=False)] = ()
