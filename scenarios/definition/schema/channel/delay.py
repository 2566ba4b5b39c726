"""What a scenario file may say of the delay of a link beyond its floor, and of its queue."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from scenarios.definition.schema.table import Table

MOST_RECORDED = 1000
"""So many recorded delays stand for all: every link of every vehicle's process holds them."""

Delay = Annotated[float, Field(ge=0, le=60_000)]
SomeDelay = Annotated[float, Field(ge=0.001, le=60_000)]
"""In ms; the least is a microsecond."""
Recorded = Annotated[tuple[Delay, ...], Field(strict=False, max_length=MOST_RECORDED)]


class OrderedTable(Table):
    """What all laws of delay have: whether messages may overtake one another ("free")."""

    order: Literal["free", "in_order"] = "free"


class CorrelatedTable(OrderedTable):
    """Beside it, for laws with chance: how much a message's delay has of the one before it.

    It is the correlation of the normal numbers that delays are drawn by; delays have that law
    whatever the correlation.
    """

    correlation_ratio: float = Field(default=0.0, ge=0, le=0.99)


class ConstantDelayTable(OrderedTable):
    """Always the same delay."""

    kind: Literal["constant"]
    delay_ms: Delay


class UniformDelayTable(CorrelatedTable):
    """Each delay between the two as likely."""

    kind: Literal["uniform"]
    delay_ms_min: Delay = 0.0
    delay_ms_max: Delay


class NormalDelayTable(CorrelatedTable):
    """Normal, cut off at 0 and at `delay_ms_max`; mean and deviation are those before the cut."""

    kind: Literal["normal"]
    mean_ms: Delay
    deviation_ms: SomeDelay
    delay_ms_max: Delay | None = None


class LognormalDelayTable(CorrelatedTable):
    """Lognormal, by the mean and the standard deviation of the delay."""

    kind: Literal["lognormal"]
    mean_ms: SomeDelay
    deviation_ms: SomeDelay


class GammaDelayTable(CorrelatedTable):
    """Gamma, by the mean and the standard deviation of the delay."""

    kind: Literal["gamma"]
    mean_ms: SomeDelay
    deviation_ms: SomeDelay


class EmpiricalDelayTable(CorrelatedTable):
    """Recorded delays, each as likely: the column delay_ms of a CSV `file`.

    When the file has been read they are `recorded_ms`, sorted, and it is their `source`. Of more
    than 1000 as many quantiles stay, evenly spread: no probability is off by more than 0.001.
    """

    kind: Literal["empirical"]
    file: Annotated[str, StringConstraints(min_length=1)] | None = None
    source: str | None = None
    recorded_ms: Recorded = ()


DelayTable = Annotated[
    ConstantDelayTable
    | UniformDelayTable
    | NormalDelayTable
    | LognormalDelayTable
    | GammaDelayTable
    | EmpiricalDelayTable,
    Field(discriminator="kind"),
]


class QueueTable(Table):
    """What the sender of a link sends a second at most, and what waits meanwhile."""

    bytes_per_s: float = Field(ge=1, le=1_000_000_000)
    depth_messages: int = Field(default=10, ge=1, le=10_000)
    drop: Literal["newest", "oldest"] = "newest"
