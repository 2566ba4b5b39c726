"""The figures of directed links, requested and achieved."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf, sqrt
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.changes import changed_links
from scenarios.definition.channel.build import ExpectedChannel, expected_channel
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.events import SourceHistory, begins, sources
from scenarios.results.link_account import (
    LONGEST_NS,
    RESOLUTION_NS,
    TRANSPORT_CAUSES,
    Link,
    LinkAccount,
    absence_lines,
    away_lines,
)
from scenarios.results.record import last_health, poses_of
from scenarios.results.tables import RunTables
from transport.columns import Array, Flags, Integers
from transport.topics import counts_as_loss
from vehicles.schedule import MILLISECOND, SECOND

# ---- Estimates with their intervals: a share of dependent events, the length of bursts, quantiles


CONFIDENCE = 0.95
"""Confidence of reported intervals."""


class ConfidenceInterval(NamedTuple):
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


def bursts(lost: Flags) -> NDArray[np.int_]:
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
    mean = int(lengths.sum()) / count
    scatter = float(lengths.var(ddof=1)) if count > 1 else 0.0
    half = quantile_of_normal(confidence) * sqrt(max(scatter, mean * (mean - 1.0)) / count)
    return ConfidenceInterval(mean, max(1.0, mean - half), mean + half if count > 1 else inf)


class Spread(NamedTuple):
    mean: float
    deviation: float
    p95: float
    largest: float


def spread(times_ns: Integers) -> Spread | None:
    """Figures (ms) of times (ns), each rounded down to 10 µs; None without any.

    The quantile is the smallest value that at least 95 % do not exceed.
    """
    if not len(times_ns):
        return None
    values, unit = np.sort(times_ns // RESOLUTION_NS), RESOLUTION_NS / MILLISECOND
    p95 = values[ceil(0.95 * len(values)) - 1]
    mean, deviation = int(values.sum()) / len(values), float(values.std())
    return Spread(mean * unit, deviation * unit, int(p95) * unit, int(values[-1]) * unit)


# ---- Link summary


SAFE_AGES_MS = tuple(range(100, 1001, 100))
"""Ages up to which data may count as fresh."""
OLDEST_S = 86_400.0
"""Largest plausible age."""
OF_VEHICLES = ("transmitter_off", "receiver_off")
"""Reasons of a vehicle rather than of the link."""
SILENT_LINK_S = 1.0
"""A link without loss that delivers nothing for this time is reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AlarmSummary:
    """False alarms of a link; `counted` is None if the receiver reports no status of the source."""

    counted: int | None = None


NO_ALARMS = AlarmSummary()
"""For a link without reported false alarms."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSummary:
    """Figures of one directed link, requested and achieved; None where they are unknown.

    The interval of the loss is of 95 % and allows for its bursts.
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
    burst_messages_max: int = 0
    """Largest number of messages lost in a row."""
    latency_ms_mean: float | None
    """Achieved mean latency of delivered messages; null if none was delivered."""
    latency_ms_deviation: float | None = None
    """Standard deviation of the achieved latency."""
    latency_ms_p95: float | None = None
    """95th percentile of the same."""
    latency_ms_max: float | None
    """Largest achieved latency; null if no message was delivered."""
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
    return sum([row.not_arrived.get(cause, 0) for cause in TRANSPORT_CAUSES])


# ---- Figures of a link from its account and the receiver's decisions


def carried_losses(account: LinkAccount) -> Flags:
    """Whether each message that a link carried was lost, in the order of numbers.

    Messages that the real transport lost are lost. Other messages without a verdict and those held
    back by the link's rate are left out.
    """
    reasons = account.verdicts["reason"]
    losses = [reason for reason in set(reasons.tolist()) if counts_as_loss(reason)]
    lost = ~account.is_delivered & np.isin(reasons, losses)
    carried, absent = account.is_delivered | lost, account.missing.number[account.missing.is_lost]
    numbers = np.append(account.verdicts["pose_seq"][carried], absent)
    _, first = np.unique(numbers, return_index=True)
    in_order: Flags = np.append(lost[carried], np.ones(len(absent), bool))[first]
    return in_order


def changed_during(run: RunTables) -> frozenset[Link]:
    """Links whose settings were changed during the run, by what their receivers report."""
    return frozenset(
        link
        for name in run.names
        for table in run.table(name, "change")["table"].tolist()
        for link in changed_links(table, run.names, run.scenario.links)
        if link[1] == name
    )


def expected(account: LinkAccount, requested: LinkTable, *, is_changed: bool) -> ExpectedChannel:
    """Expected behaviour; no loss is expected where a vehicle's own radio was off.

    Nothing is expected of a link that was changed during the run.
    """
    channel = expected_channel(requested)
    if is_changed:
        channel = replace(channel, latency_ms_mean=None)
    elif not np.isin(account.verdicts["reason"], OF_VEHICLES).any():
        return channel
    return replace(channel, loss_ratio=None, burst_messages=None)


def link_summaries(run: RunTables, counted: Mapping[Link, LinkAccount]) -> tuple[LinkSummary, ...]:
    """Figures of each link from its account, by receiver and then sender from the lead on."""
    changed, requested = changed_during(run), run.scenario.links
    return tuple(
        _summary(run, account, expected(account, requested[link], is_changed=link in changed))
        for link, account in counted.items()
    )


def _summary(run: RunTables, account: LinkAccount, channel: ExpectedChannel) -> LinkSummary:
    sender, receiver = account.link
    source = None if receiver == run.lead else sources(run, receiver).get(sender)
    requested, verdicts = run.scenario.links[account.link], account.verdicts
    lost = carried_losses(account)
    lengths, count = bursts(lost), int(lost.sum())
    burst = count / len(lengths) if count else None
    loss = share(count, len(lost), CONFIDENCE, inflation(count / max(len(lost), 1), burst or 1.0))
    delivered, delays = verdicts.of(account.is_delivered), account.latencies
    latency, numbers = spread(delays), delivered["pose_seq"]
    between = np.diff(delivered["received_at_ns"])
    transport = account.transport_delays
    if not len(transport):
        transport = _recorder_delays(run, sender)
    return LinkSummary(
        sender=sender,
        receiver=receiver,
        requested=requested,
        requested_loss_ratio=channel.loss_ratio,
        requested_burst_messages=channel.burst_messages,
        requested_latency_ms_mean=channel.latency_ms_mean,
        sent=account.sent,
        judged=len(verdicts),
        delivered=len(delivered),
        dropped=_counts(verdicts["reason"][~account.is_delivered]),
        not_arrived=account.not_arrived,
        in_flight=account.fates.get("in_flight", 0),
        unrecorded=account.fates.get("unrecorded", 0),
        copies=int(delivered["copies"].sum()),
        false=_counts(delivered["content"][delivered["content"] != ""]),
        reordered=int((numbers < np.maximum.accumulate(numbers)).sum()),
        late=int(delivered["late"].sum()),
        transport_above_floor_ratio=_above_floor(transport, requested),
        loss_ratio=loss.value,
        loss_ratio_low=loss.low,
        loss_ratio_high=loss.high,
        burst_messages_mean=burst,
        burst_messages_max=int(lengths.max(initial=0)),
        latency_ms_mean=int(delays.sum()) / len(delays) / MILLISECOND if len(delays) else None,
        latency_ms_deviation=latency.deviation if latency else None,
        latency_ms_p95=latency.p95 if latency else None,
        latency_ms_max=max(int(delays.max()), 0) / MILLISECOND if latency else None,
        **_spread_figures("transport", transport),
        **_spread_figures("arrival_gap", between[between > 0]),
        **_spread_figures("age", _plausible_ns(source)),
        false_alarms=AlarmSummary(counted=source and _false_alarms(source, run.last_at[sender])),
        safe_time_ratio=_safe_time(source),
    )


def _spread_figures(name: str, times_ns: Integers) -> dict[str, Any]:
    """Mean, 95th percentile and largest of times (ns) by the names of their figures (ms)."""
    values = spread(times_ns)
    return {
        f"{name}_ms_mean": values.mean if values else None,
        f"{name}_ms_p95": values.p95 if values else None,
        f"{name}_ms_max": values.largest if values else None,
    }


def _counts(words: Array) -> dict[str, int]:
    """Count words in alphabetical order."""
    return dict(sorted(Counter(words.tolist()).items()))


def _recorder_delays(run: RunTables, sender: str) -> Integers:
    """Times (ns) that the poses of a vehicle took to the recorder, none in virtual time."""
    poses = poses_of(run, sender)
    delays = poses.logged_at_ns - poses.at_ns
    plausible: Integers = delays[(delays != 0) & (np.abs(delays) < LONGEST_NS)]
    return plausible


def _above_floor(delays_ns: Integers, requested: LinkTable) -> float | None:
    """Share of delays on the real transport above the smallest latency of a link."""
    if not len(delays_ns):
        return None
    floor = round(requested.latency_ms * MILLISECOND / RESOLUTION_NS)
    return float((delays_ns // RESOLUTION_NS > floor).mean())


def _false_alarms(source: SourceHistory, until: int) -> int | None:
    """Count how often a source was newly lost up to an instant (ns) at which it still sent.

    None if the follower reports no status of it.
    """
    if (source.status == "unheard").all():
        return None
    return int((begins(source.status == "lost") & (source.at_ns <= until)).sum())


def _plausible_ns(source: SourceHistory | None) -> Integers:
    """Ages (ns) of data, without unknown and absurd ones."""
    age_s = np.zeros(0) if source is None else source.age_s
    nanoseconds: Integers = (age_s[(age_s >= 0.0) & (age_s <= OLDEST_S)] * SECOND).astype(np.int64)
    return nanoseconds


def _safe_time(source: SourceHistory | None) -> dict[str, float]:
    """Share of the commands with data up to each age; unknown ages are not safe."""
    if source is None or not len(source.age_s):
        return {}
    ages = _plausible_ns(source) // RESOLUTION_NS
    most = {str(limit): limit * MILLISECOND // RESOLUTION_NS for limit in SAFE_AGES_MS}
    return {limit: int((ages <= age).sum()) / len(source.age_s) for limit, age in most.items()}


# ---- Lines about links


def channel_warnings(run: RunTables, counted: Mapping[Link, LinkAccount]) -> Iterator[str]:
    """Yield lines on messages that did not arrive, and on links without requested figures."""
    yield from away_lines(run)
    yield from absence_lines(run, counted)
    if changed := changed_during(run):
        names = [f"{a} → {b}" for a, b in sorted(changed)]
        these = "all" if len(changed) == len(run.scenario.links) else ", ".join(names)
        yield f"no requested values are shown for links changed during the run: {these}"


# ---- Links that deliver nothing


def silent_links(run: RunTables, counted: Mapping[Link, LinkAccount]) -> str:
    """Report links that should lose nothing but delivered nothing; empty if there are none.

    Only the time in which the sender sends and the receiver reports counts, less the requested
    delay. A link with an end whose radio is off for a time may be silent.
    """
    exempt = changed_during(run) | run.scenario.off_links
    silent = []
    for (sender, receiver), account in counted.items():
        requested, sent_at = run.scenario.links[sender, receiver], poses_of(run, sender).at_ns
        should_deliver = requested.is_lossless and account.link not in exempt
        if not should_deliver or not len(sent_at):
            continue
        until = min(int(sent_at[-1]), run.last_at[receiver])
        expected_s = (until - max(int(sent_at[0]), run.beginning)) / SECOND
        expected_s -= (requested.latency_ms + requested.jitter_ms) / 1000.0
        if not account.is_delivered.any() and expected_s >= SILENT_LINK_S:
            silent.append(f"{sender} → {receiver} delivered none of {account.sent} poses")
    counters = {name: last_health(run, name) for name in run.names if silent}
    refused = [
        f"{name} refused {health.rejected_messages} messages"
        for name, health in counters.items()
        if health and health.rejected_messages
    ]
    return "; ".join((*silent, *refused))
