"""The effects of a directed link, from what its table asks for."""

from collections.abc import Sequence
from fractions import Fraction

from scenarios.definition.channel.content import content_effects
from scenarios.definition.channel.delay import delay_effect
from scenarios.definition.channel.loss import earlier_run, loss_effects
from scenarios.definition.channel.outages import LinkSetting, outages, vehicles_off
from scenarios.definition.channel.radio import Between, nobody, radio_effect
from scenarios.definition.schema.links import LinkTable
from transport.links.laws.effect import Effect
from transport.links.laws.plain import Decimation, Jitter, Latency, Loss
from vehicles.schedule import MILLISECOND

UNSET = LinkSetting()
"""For links without outages, or at an instant 0."""


def link_effects(
    table: LinkTable,
    source_rate_hz: float,
    setting: LinkSetting = UNSET,
    between: Between = nobody,
    besides: Sequence[Effect] = (),
) -> tuple[Effect, ...]:
    """Impairments that `table` asks of a link whose sender sends at `source_rate_hz`.

    The first that drops a message names the reason. `setting` is what some need of the run,
    `between` says which vehicles drive between sender and receiver, `besides` is what else the link
    does to messages that it carries by its rate.
    """
    if again := earlier_run(table):
        return (*again, *besides)
    found: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        found.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    found += vehicles_off(setting)
    found += besides
    found += outages(table.outages or (), setting)
    if table.loss_ratio > 0.0:
        found.append(Loss(table.loss_ratio))
    found += loss_effects(table)
    if table.radio is not None:
        found.append(radio_effect(table.radio, between))
    found.append(Latency(round(table.latency_ms * MILLISECOND)))
    if table.jitter_ms > 0.0:
        found.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    if table.delay is not None:
        found.append(delay_effect(table.delay))
    found.extend(content_effects(table.content))
    return tuple(found)
