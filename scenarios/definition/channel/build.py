"""The effects of a directed link, from what its table asks for."""

from fractions import Fraction

from scenarios.definition.schema.links import LinkTable
from transport.links.laws.effect import Effect
from transport.links.laws.plain import Decimation, Jitter, Latency, Loss
from vehicles.schedule import MILLISECOND


def link_effects(table: LinkTable, source_rate_hz: float) -> tuple[Effect, ...]:
    """Impairments that `table` asks of a link whose sender sends at `source_rate_hz`.

    The first that drops a message names the reason.
    """
    found: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        found.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    if table.loss_ratio > 0.0:
        found.append(Loss(table.loss_ratio))
    found.append(Latency(round(table.latency_ms * MILLISECOND)))
    if table.jitter_ms > 0.0:
        found.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    return tuple(found)
