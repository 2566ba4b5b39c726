"""`convoy channel fit`: fit the links of a log and write them as a TOML block."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from scenarios.results.links import CONFIDENCE, bursts, inflation, share
from scenarios.results.log_summary import PARTIAL
from scenarios.studies.channel.fit_delay import fit_delay
from scenarios.studies.channel.fit_radio import fit_radio
from scenarios.studies.channel.recorded import (
    Estimate,
    FittedKeys,
    Flags,
    RecordedLink,
    recorded_links,
    rounded,
)
from transport.links.laws.registry import KEY_OF_REASON
from transport.log.reader import LogReader

# ---- Fit the loss laws of a link to recorded fates
#
# The log states which law dropped a message. Laws judge in the order of REASON_ORDER, and the first
# law that drops a message sets the reason. Each law is therefore fitted to the messages that no
# earlier law dropped; messages dropped by later laws count as passed.


REASON_ORDER = tuple(KEY_OF_REASON)
"""Reasons in the order in which the effects of a link judge a message."""
OUTAGE_NOTE = "outages are given as times; a single run cannot show whether they depend on places"
OUTAGES = ("outage", "transmitter_off", "receiver_off")
TYPICAL_RESERVATION = 10.0
"""Mean messages of an LTE-V2X reservation, 5 to 15 at 10 Hz (3GPP TS 36.321)."""


def judged_by(link: RecordedLink, *reasons: str) -> tuple[Flags, Flags]:
    """Masks of the messages that a law with these reasons judged, and of those it dropped."""
    earlier = REASON_ORDER[: min(map(REASON_ORDER.index, reasons))]
    dropped: Flags = np.isin(link.reason, reasons)
    judged: Flags = ~np.isin(link.reason, [reason for reason in earlier if reason not in reasons])
    return judged, dropped


def _rate(link: RecordedLink) -> FittedKeys:
    skipped = link.reason == "rate"
    if not skipped.any() or not link.period_s:
        return {}, [], []
    kept = Fraction(float(1.0 - skipped.mean())).limit_denominator(100)
    rate_hz = float(kept) / link.period_s
    step = 1.0 / (len(skipped) * link.period_s)
    value = float(f"{rate_hz:.6g}")
    return {"rate_hz": value}, [Estimate("rate_hz", value, step, value - step, value + step)], []


def _outages(link: RecordedLink) -> FittedKeys:
    """Fit time windows, each from the first dropped message to the next one that passed."""
    off = np.isin(link.reason, OUTAGES)
    if not off.any():
        return {}, [], []
    known = off | (link.reason != "rate")
    off, sent_at = off[known], link.sent_at_s[known]
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off, [False])).astype(np.int8)))
    windows, estimates = [], []
    last = float(sent_at[-1]) + link.period_s
    for index, (first, after) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        from_s = float(sent_at[first])
        to_s = float(sent_at[after]) if after < len(sent_at) else last
        windows.append({"kind": "window", "from_s": round(from_s, 6), "to_s": round(to_s, 6)})
        for key, at in (("from_s", from_s), ("to_s", to_s)):
            low = max(0.0, at - link.period_s)
            estimates.append(Estimate(f"outages[{index}].{key}", at, link.period_s, low, at))
    return {"outages": windows}, estimates, [OUTAGE_NOTE]


def _independent(link: RecordedLink) -> FittedKeys:
    judged, dropped = judged_by(link, "loss")
    if not dropped.any():
        return {}, [], []
    interval = share(int(dropped.sum()), int(judged.sum()), CONFIDENCE)
    error = sqrt(interval.value * (1.0 - interval.value) / int(judged.sum()))
    estimate = Estimate("loss_ratio", interval.value, error, interval.low, interval.high)
    return {"loss_ratio": rounded(interval.value)}, [estimate], []


def _bursts(link: RecordedLink) -> FittedKeys:
    """Fit Gilbert's chain to its transitions, whose counts are binomial."""
    judged, lost = judged_by(link, "burst", "pattern")
    if not lost.any():
        return {}, [], []
    pairs = (np.diff(link.number) == 1) & judged[1:] & judged[:-1]
    before, after = lost[:-1][pairs], lost[1:][pairs]
    good, bad = int((~before).sum()), int(before.sum())
    worsened, recovered = int((~before & after).sum()), int((before & ~after).sum())
    if not worsened or not recovered:  # a single burst, or one without an end
        return _incomplete_burst(judged, lost)
    p, r = worsened / good, recovered / bad
    variance_p, variance_r = p * (1.0 - p) / good, r * (1.0 - r) / bad
    loss, burst = p / (p + r), 1.0 / r
    loss_error = sqrt(r * r * variance_p + p * p * variance_r) / (p + r) ** 2
    burst_error = sqrt(variance_r) / (r * r)
    return (
        {"loss": _gilbert(loss, max(1.0, rounded(burst)))},
        [
            Estimate.normal("loss.loss_ratio", loss, loss_error, 0.0, 1.0),
            Estimate.normal("loss.burst_messages_mean", burst, burst_error, 1.0),
            Estimate.normal("loss.good_to_bad_ratio", p, sqrt(variance_p), 0.0, 1.0),
            Estimate.normal("loss.bad_to_good_ratio", r, sqrt(variance_r), 0.0, 1.0),
        ],
        [],
    )


def _gilbert(loss: float, burst: float) -> dict[str, Any]:
    return {
        "kind": "gilbert_elliott",
        "loss_ratio": rounded(loss),
        "burst_messages_mean": burst,
    }


def _incomplete_burst(judged: Flags, lost: Flags) -> FittedKeys:
    """Fit a chain without a complete burst, whose length is known only so far."""
    losses, count = int(lost.sum()), int(judged.sum())
    burst = float(bursts(lost[judged]).max())
    interval = share(losses, count, CONFIDENCE, inflation(losses / count, burst))
    error = 0.5 * (interval.high - interval.low)
    estimate = Estimate("loss.loss_ratio", interval.value, error, interval.low, interval.high)
    return {"loss": _gilbert(interval.value, burst)}, [estimate], []


def _collisions(link: RecordedLink) -> FittedKeys:
    """Fit persistent collisions to their mean burst, for reservations of the typical length.

    With loss ratio p and probability q of keeping a resource, the reservation after a colliding one
    collides with probability c = q + (1 - q) p. The mean burst has 10 / (1 - c) messages.
    """
    judged, lost = judged_by(link, "collision")
    if not lost.any():
        return {}, [], []
    lengths, count = bursts(lost[judged]), int(judged.sum())
    loss, burst = float(lost[judged].mean()), float(lengths.mean())
    loss_error = sqrt(loss * (1.0 - loss) / count * inflation(loss, burst))
    deviation = max(float(lengths.std()), sqrt(burst * (burst - 1.0)))
    again = max(0.0, 1.0 - TYPICAL_RESERVATION / burst)
    kept = min(0.99, max(0.0, (again - loss) / (1.0 - loss))) if loss < 1.0 else 0.0
    kept_error = TYPICAL_RESERVATION * deviation / sqrt(len(lengths))
    kept_error /= burst * burst * max(1.0 - loss, 1e-9)
    return (
        {"collisions": {"loss_ratio": rounded(loss), "keep_ratio": rounded(kept)}},
        [
            Estimate.normal("collisions.loss_ratio", loss, loss_error, 0.0, 1.0),
            Estimate.normal("collisions.keep_ratio", kept, kept_error, 0.0, 0.99),
        ],
        [],
    )


def _delays(link: RecordedLink) -> FittedKeys:
    chosen = link.delivered if link.delivered.any() else ~link.delivered
    return fit_delay(link.number[chosen], link.sent_at_s[chosen], link.delay_ms[chosen])


FITTERS: Sequence[Callable[[RecordedLink], FittedKeys]] = (
    _rate,
    _outages,
    _independent,
    _bursts,
    _collisions,
    lambda link: fit_radio(link, *judged_by(link, "range")),
    _delays,
)
"""Functions that fit the laws of a link, in the order of their keys."""


# ---- Fit


USED = ("gps", "verdict", "truth", "start")
"""Topics that the fit reads."""


@dataclass(frozen=True, slots=True)
class FittedLink:
    sender: str
    receiver: str
    messages: int
    keys: dict[str, Any]
    estimates: tuple[Estimate, ...]
    notes: tuple[str, ...] = ()
    log_faults: str = ""
    """Damage and holes of the log in one line: messages without a verdict are not fitted."""

    @property
    def entry(self) -> dict[str, Any]:
        return {"sender": self.sender, "receiver": self.receiver, **self.keys}


def fit_link(link: RecordedLink, log_faults: str = "") -> FittedLink:
    parts = [fit(link) for fit in FITTERS]
    return FittedLink(
        sender=link.sender,
        receiver=link.receiver,
        messages=len(link.number),
        keys={key: value for keys, _, _ in parts for key, value in keys.items()},
        estimates=tuple(estimate for _, estimates, _ in parts for estimate in estimates),
        notes=tuple(note for _, _, notes in parts for note in notes),
        log_faults=log_faults,
    )


def fit_log(log: Path, *, partial: bool = False) -> tuple[FittedLink, ...]:
    """Fit the laws of each link of a log; raises LogError.

    A damaged or incomplete log is refused unless `partial`: messages that it lacks are left out.
    """
    reader = LogReader(log)
    if not partial:
        reader.refuse_faults(*USED, remedy=PARTIAL)
    links, faults = recorded_links(log), reader.faults_in(USED)
    return tuple(fit_link(link, faults) for link in links)


def as_toml(links: tuple[FittedLink, ...]) -> str:
    blocks = [
        f"# {faults}" for faults in dict.fromkeys(link.log_faults for link in links) if faults
    ]
    for link in links:
        head = f"# {link.sender} → {link.receiver}, {link.messages} messages; 95 % intervals:"
        lines = [head, *(f"#   {line}" for line in (*link.estimates, *link.notes))]
        # tomli_w would write a short list of tables inline, as `link = [{…}]`.
        entry = tomli_w.dumps({"link": link.entry}).replace("[link]", "[[link]]", 1)
        blocks.append("\n".join([*lines, entry.rstrip()]))
    return "\n\n".join(blocks) + "\n"
