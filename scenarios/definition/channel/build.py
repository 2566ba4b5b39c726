"""The effects and stages of a directed link, from its table."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from scenarios.definition.channel.between import Between
from scenarios.definition.schema.links import LinkTable
from transport.links.arrival import ContentStage
from transport.links.gate import PoseGate
from transport.links.laws.between import nobody
from transport.links.laws.content import ContentLaw
from transport.links.laws.effect import Effect
from transport.links.laws.law import LinkLaw, LinkSetting
from transport.links.laws.plain import Decimation, Jitter, Latency, Loss
from transport.links.laws.stage import StageLaw
from transport.links.link import Link
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
    """Impairments that `table` requests of a link whose sender sends at `source_rate_hz`.

    The first that drops a message names the reason. `setting` is what laws need of the run,
    `between` says which vehicles drive between sender and receiver, `besides` is what else the link
    does to messages that it carries by its rate.
    """
    latency = round(table.latency_ms * MILLISECOND)
    setting = replace(setting, between=between, latency=latency)
    if table.loss is not None and table.loss.replaces_others:
        return (*table.loss.effects(setting), *besides)
    found: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        found.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    found += _of(setting, *setting.radio_off)
    found += besides
    found += _of(setting, *(table.outages or ()))
    if table.loss_ratio > 0.0:
        found.append(Loss(table.loss_ratio))
    found += _of(setting, table.loss, table.collisions, table.radio)
    found.append(Latency(latency))
    if table.jitter_ms > 0.0:
        found.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    found += _of(setting, table.delay, table.content)
    return tuple(found)


def _of(setting: LinkSetting, *laws: LinkLaw | None) -> list[Effect]:
    """Effects of laws, those of one key with their places."""
    return [
        effect
        for place, law in enumerate(laws)
        if law is not None
        for effect in law.effects(replace(setting, place=place))
    ]


def link_stages(table: LinkTable) -> tuple[StageLaw, ...]:
    """What messages of the link do to one another, behind its effects."""
    return tuple(stage for law in (table.queue, table.delay) if law for stage in law.stages)


def content_stage(law: ContentLaw | None, link: Link, gate: PoseGate) -> ContentStage | None:
    """What is done to messages that arrive over `link`, whose poses pass `gate`."""
    if law is None or not law.acts_on_arrival:
        return None
    setting = LinkSetting(start_at=gate.start_at, source_rate_hz=gate.rate_hz)
    return ContentStage(
        link=link,
        gate=gate,
        duplication=law.duplication,
        filters=law.filter_duplicates,
        bit_errors=law.bit_errors,
        false=tuple(one.on_link(setting) for one in law.false),
    )


def usual_delay_ms(table: LinkTable) -> float:
    """What most messages of a link take at most: the jitter at its largest, a law at mean + 2 σ."""
    beyond = 0.0 if table.delay is None else table.delay.usual_ns / MILLISECOND
    return table.latency_ms + table.jitter_ms + beyond
