"""What a link should achieve by the law that was asked for."""

from dataclasses import dataclass
from math import sqrt

from scenarios.definition.schema.links import LinkTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedChannel:
    """Mean loss, mean length of its bursts, mean and deviation of the delay (ms).

    None where no number says it beforehand, such as a loss that depends on the distance.
    """

    loss_ratio: float | None
    burst_messages: float | None
    latency_ms_mean: float | None
    latency_ms_deviation: float | None


def expected_channel(table: LinkTable) -> ExpectedChannel:
    """Work out what follows from the laws that `table` asks for."""
    loss = table.loss_ratio
    return ExpectedChannel(
        loss_ratio=loss,
        burst_messages=1.0 / (1.0 - loss) if 0.0 < loss < 1.0 else None,
        latency_ms_mean=table.latency_ms + 0.5 * table.jitter_ms,
        latency_ms_deviation=table.jitter_ms / sqrt(12.0),
    )
