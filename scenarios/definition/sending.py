"""How often a vehicle sends, from what its table asks for, and what of it does not fit."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from scenarios.definition.schema.sending import (
    CAM_INTERVALS_MS,
    CAM_SHARES,
    EveryFixSending,
    FixedSending,
    IntervalsSending,
    SendingTable,
)
from vehicles.car.positioning.settings import GnssSettings
from vehicles.car.sending import SHORTEST, Shares, awareness_interval, quiet_at
from vehicles.schedule import MILLISECOND, SECOND


def shares_of(table: IntervalsSending) -> Shares:
    """Intervals, how often each comes, and the jitter about them."""
    intervals, shares = table.intervals_ms, table.shares_ratio
    if table.table is not None:
        intervals, shares = CAM_INTERVALS_MS, CAM_SHARES[table.table]
    return Shares(
        [round(interval * MILLISECOND) for interval in intervals],
        shares,
        round(table.jitter_ms * MILLISECOND),
    )


def sends_every_instant(table: SendingTable, gnss: GnssSettings) -> bool:
    """Whether a message goes out at each instant of measuring, from the first one on."""
    return isinstance(table, EveryFixSending) and table.dcc is None and gnss.is_punctual


def highest_rate_hz(table: SendingTable, gnss: GnssSettings) -> float:
    """Rate that the sender never exceeds, counted from the start: no fix is sent twice."""
    match table.kind:
        case "every_fix":
            return gnss.rate
        case "fixed":
            return min(table.rate_hz, gnss.rate)
        case "profile":
            return min(max(point.rate_hz for point in table.profile), gnss.rate)
        case "cam":
            return min(SECOND / SHORTEST, gnss.rate)
        case "intervals":
            return min(SECOND / shares_of(table).shortest, gnss.rate)


def even_rate_hz(table: SendingTable, gnss: GnssSettings) -> float | None:
    """Rate of messages that come evenly, None where they do not."""
    if table.dcc is None and isinstance(table, EveryFixSending | FixedSending):
        return highest_rate_hz(table, gnss)
    return None


def link_rate_hz(table: SendingTable, gnss: GnssSettings) -> float:
    """Rate by which a link of a lower one holds messages back: the even one, or the highest."""
    return even_rate_hz(table, gnss) or highest_rate_hz(table, gnss)


def usual_rate_hz(table: SendingTable, gnss: GnssSettings, speed: float) -> float:
    """Messages a second at a constant speed (m/s), straight on.

    The lowest of a rate that changes but is not 0, the mean where intervals are drawn, the slowest
    that congestion control comes to.
    """
    match table.kind:
        case "profile":
            rates = [point.rate_hz for point in table.profile if point.rate_hz > 0.0]
            rate = min(rates, default=0.0)
        case "cam":
            rate = 1.0 / awareness_interval(speed, table.check_period_ms / 1000.0)
        case "intervals":
            drawn = shares_of(table)
            whole = sum(i * s for i, s in zip(drawn.intervals, drawn.shares, strict=True))
            rate = SECOND * sum(drawn.shares) / whole
        case _:
            rate = gnss.rate if table.kind == "every_fix" else table.rate_hz
    return min(rate, gnss.rate, _controlled_rate_hz(table))


def _controlled_rate_hz(table: SendingTable) -> float:
    if table.dcc is None:
        return float("inf")
    busiest = max(point.busy_ratio for point in table.dcc.busy)
    return SECOND / quiet_at(busiest)


def sending_problems(table: SendingTable) -> Iterator[tuple[str, str]]:
    """Give every key of a table of sending that does not fit the others."""
    if table.dcc is not None:
        yield from _order("dcc.busy", [point.at_s for point in table.dcc.busy])
    match table.kind:
        case "profile":
            yield from _order("profile", [point.at_s for point in table.profile])
        case "fixed":
            yield from _phase(table.phase_s, 1.0 / table.rate_hz, drawn=table.drawn_phase)
        case "cam":
            period = table.check_period_ms / 1000.0
            yield from _phase(table.phase_s, period, drawn=table.drawn_phase)
        case "intervals":
            yield from _interval_problems(table)


def _order(key: str, times: Sequence[float]) -> Iterator[tuple[str, str]]:
    for index, (before, after) in enumerate(pairwise(times), 1):
        if after <= before:
            yield (
                f"{key}[{index}].at_s",
                f"given {after:g}, allowed more than {before:g}, the entry before",
            )


def _phase(phase_s: float, period_s: float, *, drawn: bool) -> Iterator[tuple[str, str]]:
    if drawn and phase_s:
        yield "phase_s", f"given {phase_s:g} together with drawn_phase, allowed one of them"
    elif phase_s >= period_s:
        yield "phase_s", f"given {phase_s:g}, allowed less than {period_s:g}, the period"


def _interval_problems(table: IntervalsSending) -> Iterator[tuple[str, str]]:
    intervals, shares = len(table.intervals_ms), len(table.shares_ratio)
    if table.table is None and not intervals:
        allowed = ", ".join(f'"{name}"' for name in CAM_SHARES)
        yield "table", f"missing, allowed {allowed}, or intervals_ms with shares_ratio"
    elif table.table is not None and (intervals or shares):
        yield "table", "given together with intervals_ms or shares_ratio, allowed one of them"
    elif intervals and intervals != shares:
        yield "shares_ratio", f"given {shares} numbers, allowed {intervals} as intervals_ms"
    elif intervals and sum(table.shares_ratio) <= 0.0:
        yield "shares_ratio", "given nothing but 0, allowed more than that for one of them"
    elif (least := min(shares_of(table).intervals) / MILLISECOND) <= 4.0 * table.jitter_ms:
        yield (
            "jitter_ms",
            f"given {table.jitter_ms:g}, allowed less than a quarter of the shortest interval, "
            f"{least:g} ms",
        )
