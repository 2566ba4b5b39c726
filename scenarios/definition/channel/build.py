"""The effects and stages of a directed link, from its table."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np

from scenarios.definition.road.route import Route
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.plug_ins.channel import effects_of
from transport.links.content_stage import ContentStage
from transport.links.gate import PoseGate
from transport.links.laws.basic import Decimation, Jitter, Latency, Loss
from transport.links.laws.content import ContentLaw
from transport.links.laws.effect import Effect
from transport.links.laws.link_law import LinkLaw, LinkSetting
from transport.links.laws.stage import StageLaw
from transport.links.laws.vehicles_between import Road, VehiclesBetween, no_vehicles
from transport.links.link import Link
from vehicles.geometry.sampled_path import SampledPath
from vehicles.schedule import MILLISECOND

UNSET = LinkSetting()
"""For links without outages, or at time 0."""

ROAD_STEP = 2.0
"""Distance (m) between samples of the road for vehicles in between."""

Between = Callable[[], VehiclesBetween]
"""Returns the vehicles between sender and receiver, and their road."""


def link_effects(
    table: LinkTable,
    source_rate_hz: float,
    setting: LinkSetting = UNSET,
    between: Between = no_vehicles,
    besides: Sequence[Effect] = (),
) -> tuple[Effect, ...]:
    """Build the effects of a link whose sender sends at `source_rate_hz`.

    The first effect that drops a message names the reason. `between` returns the vehicles between
    the ends. `besides` are additional effects after the rate of the link.
    """
    latency = round(table.latency_ms * MILLISECOND)
    setting = replace(setting, between=between, latency=latency)
    if table.loss is not None and table.loss.replaces_others:
        return (*effects_of(table.loss, setting), *besides)
    result: list[Effect] = []
    if table.rate_hz is not None and table.rate_hz < source_rate_hz:
        result.append(Decimation(Fraction(table.rate_hz) / Fraction(source_rate_hz)))
    result += _of(setting, *setting.radio_off)
    result += besides
    result += _of(setting, *(table.outages or ()))
    if table.loss_ratio > 0.0:
        result.append(Loss(table.loss_ratio))
    result += _of(setting, table.loss, table.collisions, table.radio)
    result.append(Latency(latency))
    if table.jitter_ms > 0.0:
        result.append(Jitter(round(table.jitter_ms * MILLISECOND)))
    result += _of(setting, table.delay, table.content)
    return tuple(result)


def _of(setting: LinkSetting, *laws: LinkLaw | None) -> list[Effect]:
    return [
        effect
        for place, law in enumerate(laws)
        if law is not None
        for effect in effects_of(law, replace(setting, place=place))
    ]


def link_stages(table: LinkTable) -> tuple[StageLaw, ...]:
    return tuple(stage for law in (table.queue, table.delay) if law for stage in law.stages)


def content_stage(law: ContentLaw | None, link: Link, gate: PoseGate) -> ContentStage | None:
    if law is None or not law.alters_messages:
        return None
    setting = LinkSetting(start_at=gate.start_at, source_rate_hz=gate.rate_hz)
    return ContentStage(
        link=link,
        gate=gate,
        duplication=law.duplication,
        filters=law.filter_duplicates,
        bit_errors=law.bit_errors,
        false=tuple(one.for_link(setting) for one in law.false),
    )


def usual_delay_ms(table: LinkTable) -> float:
    """Return a delay that most messages do not exceed: largest jitter, and mean + 2 σ of a law."""
    beyond = 0.0 if table.delay is None else table.delay.typical_max_ns / MILLISECOND
    return table.latency_ms + table.jitter_ms + beyond


def vehicles_between(route: Route, sender: int, receiver: int) -> VehiclesBetween:
    first = float(route.path.station[0])
    return VehiclesBetween(
        count=max(abs(receiver - sender) - 1, 0),
        road=_road(route.path),
        sender_start=route.start_station(sender) - first,
        receiver_start=route.start_station(receiver) - first,
    )


def _road(path: SampledPath) -> Road:
    """Sample a path, with a straight extension at its end."""
    first, count = float(path.station[0]), int(path.length / ROAD_STEP) + 1
    nodes = first + ROAD_STEP * np.arange(count)
    beyond = [path.at(first + ROAD_STEP * (count + more)) for more in (0, 1)]
    return Road(
        ROAD_STEP,
        (*np.interp(nodes, path.station, path.east).tolist(), *(point.east for point in beyond)),
        (*np.interp(nodes, path.station, path.north).tolist(), *(point.north for point in beyond)),
    )
