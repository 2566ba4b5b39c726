"""The figures of one directed link, requested and achieved."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.build import ExpectedChannel, expected_channel
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.account import CAUSE_WORDS, TRANSPORT_CAUSES, LinkAccount
from scenarios.results.link_tally import RESOLUTION_NS, LinkTally
from vehicles.schedule import MILLISECOND

# ---- Estimates with their intervals: a share of dependent events, the length of bursts, quantiles


CONFIDENCE = 0.95
"""Confidence of reported intervals."""
CERTAINTY = 0.9999
"""Confidence beyond which a figure deviates from its request."""


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    value: float
    low: float
    high: float


def quantile_of_normal(confidence: float) -> float:
    """Half-width, in standard deviations, of the central interval of a normal law."""
    return NormalDist().inv_cdf(0.5 + 0.5 * confidence)


def share(count: float, of: float, confidence: float, inflation: float = 1.0) -> ConfidenceInterval:
    """Wilson's interval of a share (E. B. Wilson, JASA 22, 1927) of `of` events.

    `inflation` divides the number of independent events: for a chain with the lag-one correlation r
    it is (1 + r) / (1 - r). Without events the interval is [0, 1].
    """
    if of <= 0.0:
        return ConfidenceInterval(0.0, 0.0, 1.0)
    ratio, n, z = count / of, max(of / inflation, 1.0), quantile_of_normal(confidence)
    centre = (ratio + z * z / (2.0 * n)) / (1.0 + z * z / n)
    half = z / (1.0 + z * z / n) * sqrt(ratio * (1.0 - ratio) / n + z * z / (4.0 * n * n))
    return ConfidenceInterval(ratio, max(0.0, centre - half), min(1.0, centre + half))


def inflation(loss_ratio: float, burst: float) -> float:
    """Variance of a loss share with bursts, relative to that of independent losses; at least 1.

    In the two-state chain (Gilbert) with this share and mean burst length the lag-one correlation
    is r = 1 - 1/burst - loss/(burst (1 - loss)), and the factor is (1 + r) / (1 - r).
    """
    if not 0.0 < loss_ratio < 1.0 or burst <= 1.0:
        return 1.0
    correlation = 1.0 - 1.0 / burst - loss_ratio / (burst * (1.0 - loss_ratio))
    return max(1.0, (1.0 + correlation) / (1.0 - correlation)) if correlation < 1.0 else 1.0


def bursts(lost: NDArray[np.bool_]) -> NDArray[np.int_]:
    """Lengths of the runs of losses, in the order of message numbers."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], lost, [False])).astype(np.int8)))
    lengths: NDArray[np.int_] = edges[1::2] - edges[::2]
    return lengths


def mean_length(lengths: NDArray[np.int_], confidence: float) -> ConfidenceInterval | None:
    """Mean of lengths with its interval, None without any; a single one has no upper bound.

    The standard error of the mean b of m geometric lengths is sqrt(b (b - 1) / m), or that of the
    sample where it is larger.
    """
    count = len(lengths)
    if not count:
        return None
    each = lengths.tolist()
    first, second = sum(each), sum(length * length for length in each)
    mean = first / count
    scatter = (count * second - first * first) / (count * (count - 1)) if count > 1 else 0.0
    spread = sqrt(max(scatter, mean * (mean - 1.0))) / sqrt(count)
    half = quantile_of_normal(confidence) * spread
    return ConfidenceInterval(
        mean, max(1.0, mean - half), mean + half if count > 1 else float("inf")
    )


@dataclass(frozen=True, slots=True)
class Spread:
    mean: float
    deviation: float
    p95: float
    largest: float
    count: int


def spread(histogram: Mapping[int, int], unit: float) -> Spread | None:
    """Figures of values counted as multiples of `unit`, None without any.

    The quantile is the smallest value that at least 95 % do not exceed.
    """
    if not histogram:
        return None
    # In whole numbers, so that the figures are the same on every machine.
    total = sum(histogram.values())
    first = sum(count * value for value, count in histogram.items())
    second = sum(count * value * value for value, count in histogram.items())
    ordered, below = sorted(histogram), 0
    p95 = ordered[-1]
    for value in ordered:
        below += histogram[value]
        if below >= 0.95 * total:
            p95 = value
            break
    return Spread(
        first / total * unit,
        sqrt((total * second - first * first) / (total * total)) * unit,
        p95 * unit,
        ordered[-1] * unit,
        total,
    )


# ---- Link summary


SAFE_AGES_MS = tuple(range(100, 1001, 100))
"""Ages up to which data may count as fresh."""
LEAST_MESSAGES = 100
"""Fewest messages of which the loss is compared with the requested one ..."""
LEAST_INDEPENDENT = 50
"""... and fewest independent ones, by the inflation of bursts."""
ROUNDING_MS = 0.01
"""Delays are whole nanoseconds, and counted to 10 µs."""
OF_VEHICLES = {"transmitter_off", "receiver_off"}
"""Reasons of a vehicle rather than of the link."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSummary:
    """False alarms of a link; `counted` is None if the receiver reports no status of the source."""

    counted: int | None = None


NO_ALARMS = AlarmSummary()
"""For a link without reported false alarms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSummary:
    """Figures of one directed link, requested and achieved; None where they are unknown.

    Intervals are of 95 %; those of the loss allow for its bursts.
    """

    sender: str
    """Vehicle that sends; each link has a direction."""
    receiver: str
    """Receiving vehicle, which applies the link's settings."""
    requested: LinkTable
    """Requested settings, by the keys of [links] in a scenario (null: not requested)."""
    requested_loss_ratio: float | None = None
    """Requested loss of all laws together; null where no number is known, such as for a loss that
    depends on the distance."""
    requested_burst_messages: float | None = None
    """Requested mean number of messages lost in a row."""
    requested_latency_ms_mean: float | None = None
    """Requested mean time from sending to reception of delivered messages."""
    requested_latency_ms_deviation: float | None = None
    """Standard deviation of the same."""
    sent: int
    """Messages sent over the link: delivered, dropped, not arrived, in flight and unrecorded."""
    judged: int
    """Messages that reached the link's receiver."""
    delivered: int
    """Messages delivered."""
    dropped: Mapping[str, int]
    """Messages dropped, by reason."""
    not_arrived: Mapping[str, int] = field(default_factory=dict)
    """Messages that did not reach the receiver, by cause: receiver_down (its software did not run),
    late_start (sent before the transport was ready), cut_off (one of the vehicles was out of reach
    of the recorder), router_away (all vehicles were), or unknown."""
    in_flight: int = 0
    """Messages without a verdict at the end: those that had arrived and were not due, which is
    exact, and a bound: those sent so late that they may have arrived after the receiver's last look
    (0.1 s after its end), by the largest delay on this link."""
    unrecorded: int = 0
    """Messages whose fate is missing in the log; they are not part of the loss."""
    copies: int = 0
    """Duplicates that the channel added."""
    false: Mapping[str, int]
    """Delivered messages whose content the channel changed, by kind."""
    reordered: int = 0
    """Messages delivered after one with a greater number."""
    late: int
    """Messages received after the tick that needed them."""
    transport_ms_mean: float | None = None
    """Mean time that messages took on the real transport up to the receiver's process, from the
    instant at which they were due; null in virtual time."""
    transport_ms_p95: float | None = None
    """95th percentile of the same."""
    transport_ms_max: float | None = None
    """Largest of the same."""
    transport_above_floor_ratio: float | None = None
    """Share of these messages that took longer than the link's smallest latency, so that the
    receiver may have got them late."""
    loss_ratio: float
    """Achieved loss, of the messages that the link carries: dropped ones and those that the real
    transport lost (late_start, cut_off, router_away, unknown)."""
    loss_ratio_low: float = 0.0
    """Lower end of its 95 % interval, which allows for bursts."""
    loss_ratio_high: float = 1.0
    """Upper end of the same."""
    burst_messages_mean: float | None = None
    """Mean number of messages lost in a row."""
    burst_messages_low: float | None = None
    """Lower end of its 95 % interval."""
    burst_messages_high: float | None = None
    """Upper end of the same; null where a single burst does not determine it."""
    burst_messages_max: int = 0
    """Largest number of messages lost in a row."""
    latency_ms_mean: float
    """Achieved mean latency of delivered messages."""
    latency_ms_low: float | None = None
    """Lower end of its 95 % interval, as if the delays were independent."""
    latency_ms_high: float | None = None
    """Upper end of the same."""
    latency_ms_deviation: float | None = None
    """Standard deviation of the achieved latency."""
    latency_ms_p95: float | None = None
    """95th percentile of the same."""
    latency_ms_max: float
    """Largest achieved latency."""
    arrival_gap_ms_mean: float | None = None
    """Mean time between two instants with a delivery."""
    arrival_gap_ms_p95: float | None = None
    """95th percentile of the same."""
    arrival_gap_ms_max: float | None = None
    """Largest of the same."""
    age_ms_mean: float | None = None
    """Mean age of the newest data of the sender at the receiver's steering commands."""
    age_ms_p95: float | None = None
    """95th percentile of the same."""
    age_ms_max: float | None = None
    """Largest of the same."""
    false_alarms: AlarmSummary = NO_ALARMS
    """False alarms, at which the receiver considered the sender lost although it sent. `counted` is
    their number (null if the receiver does not report it)."""
    safe_time_ratio: Mapping[str, float]
    """Share of the steering commands whose data is no older than KEY milliseconds."""


def lost_in_transport(row: LinkSummary) -> int:
    """Count the messages that the real transport lost."""
    return sum([count for cause, count in row.not_arrived.items() if cause in TRANSPORT_CAUSES])


def link_summary(
    link: tuple[str, str],
    requested: LinkTable,
    account: LinkAccount,
    tally: LinkTally,
    *,
    alarms: AlarmSummary = NO_ALARMS,
    transport: Mapping[int, int] | None = None,
) -> LinkSummary:
    """Summarise a link (sender, receiver).

    `transport` counts the delays on the real transport, in multiples of RESOLUTION_NS.
    """
    expected = _expected(requested, tally)
    loss, burst, longest = _losses(tally.lost(account.absent_numbers), CONFIDENCE)
    milliseconds = RESOLUTION_NS / MILLISECOND
    latency = spread(tally.latencies, milliseconds)
    mean = tally.latency_ns_sum / tally.delivered / MILLISECOND if tally.delivered else 0.0
    half = _half_of_mean(latency, expected)
    gap, age = spread(tally.arrival_gaps, milliseconds), spread(tally.ages, milliseconds)
    real = spread(transport or {}, milliseconds)
    return LinkSummary(
        sender=link[0],
        receiver=link[1],
        requested=requested,
        requested_loss_ratio=expected.loss_ratio,
        requested_burst_messages=expected.burst_messages,
        requested_latency_ms_mean=expected.latency_ms_mean,
        requested_latency_ms_deviation=expected.latency_ms_deviation,
        sent=account.sent,
        judged=tally.delivered + tally.dropped.total(),
        delivered=tally.delivered,
        dropped=dict(sorted(tally.dropped.items())),
        not_arrived=dict(account.not_arrived),
        in_flight=account.in_flight,
        unrecorded=account.unrecorded,
        copies=tally.copies,
        false=dict(sorted(tally.false.items())),
        reordered=tally.reordered,
        late=tally.late,
        transport_ms_mean=real.mean if real else None,
        transport_ms_p95=real.p95 if real else None,
        transport_ms_max=real.largest if real else None,
        transport_above_floor_ratio=_above_floor(transport, requested) if transport else None,
        loss_ratio=loss.value,
        loss_ratio_low=loss.low,
        loss_ratio_high=loss.high,
        burst_messages_mean=burst.value if burst else None,
        burst_messages_low=burst.low if burst else None,
        burst_messages_high=burst.high if burst else None,
        burst_messages_max=longest,
        latency_ms_mean=mean,
        latency_ms_low=mean - half if latency else None,
        latency_ms_high=mean + half if latency else None,
        latency_ms_deviation=latency.deviation if latency else None,
        latency_ms_p95=latency.p95 if latency else None,
        latency_ms_max=tally.latency_ns_max / MILLISECOND,
        arrival_gap_ms_mean=gap.mean if gap else None,
        arrival_gap_ms_p95=gap.p95 if gap else None,
        arrival_gap_ms_max=gap.largest if gap else None,
        age_ms_mean=age.mean if age else None,
        age_ms_p95=age.p95 if age else None,
        age_ms_max=age.largest if age else None,
        false_alarms=alarms,
        safe_time_ratio=_safe_time(tally),
    )


def _expected(requested: LinkTable, tally: LinkTally) -> ExpectedChannel:
    """Expected behaviour; no loss is expected where a vehicle's own radio was off.

    Nothing is expected of a link that was changed during the run.
    """
    expected = expected_channel(requested)
    if tally.changed:
        return ExpectedChannel(
            loss_ratio=None,
            burst_messages=None,
            latency_ms_mean=None,
            latency_ms_deviation=None,
            loss_inflation=expected.loss_inflation,
            latency_inflation=expected.latency_inflation,
            settles=False,
        )
    if OF_VEHICLES & tally.dropped.keys():
        return replace(expected, loss_ratio=None, burst_messages=None)
    return expected


def describe_link(row: LinkSummary) -> str:
    """Achieved and requested figures of a link in one line, with intervals of 95 %."""
    requested_loss, requested_ms = row.requested_loss_ratio, row.requested_latency_ms_mean
    parts = [
        f"{row.sender} → {row.receiver}: lost {100 * row.loss_ratio:.1f} % "
        f"({100 * row.loss_ratio_low:.1f} to {100 * row.loss_ratio_high:.1f}) of its messages, "
        f"requested {'-' if requested_loss is None else f'{100 * requested_loss:.3g} %'}"
    ]
    parts += [
        f"{row.not_arrived[cause]} not arrived ({words})"
        for cause, words in CAUSE_WORDS.items()
        if cause in row.not_arrived
    ]
    if row.burst_messages_mean is not None:
        parts.append(f"{row.burst_messages_mean:.2f} in a row, {row.burst_messages_max} at most")
    if row.latency_ms_low is not None and row.latency_ms_high is not None:
        parts.append(
            f"delayed {row.latency_ms_mean:.1f} ms ({row.latency_ms_low:.1f} to "
            f"{row.latency_ms_high:.1f}), requested "
            f"{'-' if requested_ms is None else f'{requested_ms:.4g}'}"
        )
    if row.age_ms_mean is not None:
        parts.append(f"{row.age_ms_mean:.0f} ms old at commands, {row.age_ms_max:.0f} at most")
    return "; ".join(parts)


def _losses(
    lost: NDArray[np.bool_], confidence: float
) -> tuple[ConfidenceInterval, ConfidenceInterval | None, int]:
    """Loss and mean burst length with their intervals, and the longest burst."""
    lengths = bursts(lost)
    burst = mean_length(lengths, confidence)
    count, of = int(lost.sum()), len(lost)
    spread_by = inflation(count / of, burst.value) if burst else 1.0
    return share(count, of, confidence, spread_by), burst, int(lengths.max(initial=0))


def _half_of_mean(latency: Spread | None, expected: ExpectedChannel) -> float:
    """Half the width (ms) of the interval of a mean delay with the requested correlation."""
    if latency is None:
        return 0.0
    error = latency.deviation * sqrt(expected.latency_inflation / latency.count)
    return quantile_of_normal(CONFIDENCE) * error


def _above_floor(transport: Mapping[int, int], requested: LinkTable) -> float:
    """Share of delays on the real transport above the smallest latency of a link."""
    floor = round(requested.latency_ms * MILLISECOND / RESOLUTION_NS)
    above = sum([count for delay, count in transport.items() if delay > floor])
    return above / sum(transport.values())


def _safe_time(tally: LinkTally) -> dict[str, float]:
    if not tally.commands:
        return {}
    within = {}
    for limit_ms in SAFE_AGES_MS:
        most = limit_ms * MILLISECOND // RESOLUTION_NS
        within[str(limit_ms)] = sum(n for age, n in tally.ages.items() if age <= most)
    return {limit: count / tally.commands for limit, count in within.items()}


def request_deviations(
    link: tuple[str, str], requested: LinkTable, tally: LinkTally, absent: Sequence[int] = ()
) -> Iterator[str]:
    """Yield a line per figure of a link that deviates beyond sampling error from its request.

    Intervals are of 99.99 %, so one of ten thousand correct figures lies outside. `absent` are the
    numbers of messages that the real transport lost.
    """
    expected, name = _expected(requested, tally), f"{link[0]} → {link[1]}"
    lost = tally.lost(absent)
    loss, burst, _ = _losses(lost, CERTAINTY)
    requested_loss = expected.loss_ratio if expected.settles else None
    count = len(lost)
    least = max(LEAST_MESSAGES, LEAST_INDEPENDENT * expected.loss_inflation)
    if requested_loss is not None and count >= least:
        wide = share(loss.value * count, count, CERTAINTY, expected.loss_inflation)
        low, high = min(loss.low, wide.low), max(loss.high, wide.high)
        if not low - 1e-12 <= requested_loss <= high + 1e-12:
            yield (
                f"{name}: lost {100 * loss.value:.2f} % of {count} messages (99.99 % interval "
                f"{100 * low:.2f} to {100 * high:.2f} %), requested {100 * requested_loss:g} %"
            )
        if expected.burst_messages is not None and burst is not None:
            yield from _burst_miss(name, expected, burst, lost)
    yield from _latency_miss(name, expected, tally)


def _burst_miss(
    name: str, expected: ExpectedChannel, burst: ConfidenceInterval, lost: NDArray[np.bool_]
) -> Iterator[str]:
    """Compare mean bursts. Where losses are clustered, their count varies as well.

    The mean is the number of losses over that of bursts, so it varies at least as the former does.
    """
    requested, loss = expected.burst_messages or 1.0, expected.loss_ratio or 1.0
    number, count = len(bursts(lost)), len(lost)
    of_lengths = max(requested * (requested - 1.0), 0.0) / number
    of_losses = requested * requested * expected.loss_inflation * (1.0 - loss) / (loss * count)
    clustered = expected.loss_inflation > 1.0
    error = sqrt(max(of_lengths, of_losses) if clustered else of_lengths)
    half = quantile_of_normal(CERTAINTY) * error
    low, high = min(burst.low, burst.value - half), max(burst.high, burst.value + half)
    if not low - 1e-9 <= requested <= high + 1e-9:
        yield (
            f"{name}: {number} bursts of {burst.value:.2f} lost messages on average (99.99 % "
            f"interval {low:.2f} to {high:.2f}), requested {requested:.2f}"
        )


def _latency_miss(name: str, expected: ExpectedChannel, tally: LinkTally) -> Iterator[str]:
    mean, deviation = expected.latency_ms_mean, expected.latency_ms_deviation
    if mean is None or deviation is None or tally.delivered < LEAST_MESSAGES:
        return
    achieved = tally.latency_ns_sum / tally.delivered / MILLISECOND
    sample = spread(tally.latencies, RESOLUTION_NS / MILLISECOND)
    widest = max(deviation, sample.deviation if sample else 0.0)  # of laws with long tails
    error = widest * sqrt(expected.latency_inflation / tally.delivered)
    half = quantile_of_normal(CERTAINTY) * error + ROUNDING_MS
    if abs(achieved - mean) > half:
        late = f"; {tally.late} of {tally.delivered} were late" if tally.late else ""
        yield (
            f"{name}: delayed by {achieved:.3f} ms on average, requested {mean:.3f} ± {half:.3f} ms"
            f"{late}"
        )
