"""What a link does to the content and the number of messages, from what its table asks for."""

from collections.abc import Iterator
from math import inf

from scenarios.definition.schema.channel.content import (
    AnyFalseTable,
    ContentTable,
    DriftingTable,
    FalseTable,
    FrozenTable,
    GhostTable,
    OffsetTable,
    ReplayedTable,
)
from scenarios.definition.schema.tables import ScenarioTables
from transport.links.arrival import ContentStage
from transport.links.gate import PoseGate
from transport.links.laws.content import BitErrors, Duplication, Reordering
from transport.links.laws.effect import Effect
from transport.links.laws.false_content import (
    FalseContent,
    FalseDrift,
    FalseOffset,
    FalseSpell,
    FrozenContent,
    GhostVehicle,
    ReplayedContent,
    Shift,
)
from transport.links.link import Link
from vehicles.schedule import MILLISECOND, SECOND


def content_effects(table: ContentTable | None) -> Iterator[Effect]:
    """Give what of it is a delay, and so an effect among the others."""
    if table is not None and table.reorder_ratio > 0.0:
        yield Reordering(table.reorder_ratio, round(table.reorder_delay_ms * MILLISECOND))


def content_stage(table: ContentTable | None, link: Link, gate: PoseGate) -> ContentStage | None:
    """All the rest of what is asked of `link`, whose poses pass `gate`; None if that is nothing."""
    if table is None or not (table.duplicate_ratio or table.bit_error_ratio or table.false):
        return None
    delay_ms = table.duplicate_delay_ms
    delay = None if delay_ms is None else round(delay_ms * MILLISECOND)
    errors = BitErrors(table.bit_error_ratio, table.frame_check)
    return ContentStage(
        link=link,
        gate=gate,
        duplication=Duplication(table.duplicate_ratio, delay) if table.duplicate_ratio else None,
        filters=table.filter_duplicates,
        bit_errors=errors if table.bit_error_ratio else None,
        false=tuple(_false_content(one, gate) for one in table.false),
    )


def _false_content(table: AnyFalseTable, gate: PoseGate) -> FalseContent:
    span = _span(table, gate.start_at)
    match table:
        case OffsetTable():
            return FalseOffset(
                span, Shift(table.east_m, table.north_m, table.ahead_m, table.left_m)
            )
        case DriftingTable():
            return FalseDrift(
                span, Shift(table.east_mps, table.north_mps, table.ahead_mps, table.left_mps)
            )
        case FrozenTable():
            return FrozenContent(span)
        case ReplayedTable():
            return ReplayedContent(span, round(table.age_s * SECOND))
        case GhostTable():
            # Midway between two true messages of a sender that sends as often as it may.
            after = round(SECOND / (2.0 * gate.rate_hz))
            return GhostVehicle(span, Shift(ahead=table.ahead_m, left=table.left_m), after)


def _span(table: FalseTable, start_at: int) -> FalseSpell:
    to_at = inf if table.to_s is None else start_at + round(table.to_s * SECOND)
    return FalseSpell(start_at + round(table.from_s * SECOND), to_at)


def content_problems(tables: ScenarioTables) -> Iterator[tuple[str, str]]:
    """Give every key of false content that does not fit the others, and what is wrong with it."""
    given = {"links": tables.links} | {f"link[{k}]": one for k, one in enumerate(tables.link)}
    for place, link in given.items():
        for index, one in enumerate(link.content.false if link.content else ()):
            key = f"{place}.content.false[{index}]"
            if one.to_s is not None and one.to_s <= one.from_s:
                yield f"{key}.to_s", f"given {one.to_s}, allowed more than from_s, {one.from_s}"
            ways = [name for name in type(one).model_fields if name.endswith(("_m", "_mps"))]
            if ways and not any(getattr(one, name) for name in ways):
                yield key, f"moves nothing, allowed other than 0 in {', '.join(ways)}"
