"""`convoy channel fit`: fit the links of a log and write them as a TOML block."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from scenarios.results.links import CONFIDENCE, bursts, inflation, share
from scenarios.results.log_summary import PARTIAL
from scenarios.studies.channel.fit_delay import fit_delay
from scenarios.studies.channel.fit_radio import FittedKeys, fit_radio
from scenarios.studies.channel.recorded import Estimate, RecordedLink, recorded_links
from transport.links.laws.registry import KEY_OF_REASON
from transport.log.reader import LogReader

# ---- Fit the loss laws of a link to recorded fates
#
# The log states which law dropped a message. Laws judge in the order of REASON_ORDER, and the first
# law that drops a message sets the reason. Each law is therefore fitted to the messages that no
# earlier law dropped; messages dropped by later laws count as passed.


Flags = NDArray[np.bool_]

REASON_ORDER = tuple(KEY_OF_REASON)
"""Reasons in the order in which the effects of a link judge a message."""
OUTAGE_NOTE = "outages are given as times; a single run cannot show whether they depend on places"
OUTAGES = ("outage", "transmitter_off", "receiver_off")
TYPICAL_RESERVATION = 10.0
"""Mean messages of an LTE-V2X reservation, 5 to 15 at 10 Hz (3GPP TS 36.321)."""


def fit_losses(link: RecordedLink) -> FittedKeys:
    keys: dict[str, Any] = {}
    estimates: list[Estimate] = []
    notes: list[str] = []
    for fitter in FITTERS.values():
        fitted_keys, fitted_estimates, fitted_notes = fitter(link)
        keys |= fitted_keys
        estimates += fitted_estimates
        notes += fitted_notes
    return keys, estimates, notes


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
    return {"loss_ratio": _rounded(interval.value)}, [estimate], []


def _transitions(link: RecordedLink, judged: Flags, lost: Flags) -> tuple[int, int, int, int]:
    """Count successive pairs: first passed, of these second lost; first lost, second passed."""
    pairs = (np.diff(link.number) == 1) & judged[1:] & judged[:-1]
    before, after = lost[:-1][pairs], lost[1:][pairs]
    return (
        int((~before).sum()), int((~before & after).sum()),
        int(before.sum()), int((before & ~after).sum()),
    )  # fmt: skip


def _bursts(link: RecordedLink) -> FittedKeys:
    """Fit Gilbert's chain to its transitions, whose counts are binomial."""
    judged, lost = judged_by(link, "burst", "pattern")
    if not lost.any():
        return {}, [], []
    good, worsened, bad, recovered = _transitions(link, judged, lost)
    if not worsened or not recovered:  # a single burst, or one without an end
        return _incomplete_burst(judged, lost)
    p, r = worsened / good, recovered / bad
    variance_p, variance_r = p * (1.0 - p) / good, r * (1.0 - r) / bad
    loss, burst = p / (p + r), 1.0 / r
    loss_error = sqrt(r * r * variance_p + p * p * variance_r) / (p + r) ** 2
    burst_error = sqrt(variance_r) / (r * r)
    table = {
        "kind": "gilbert_elliott",
        "loss_ratio": _rounded(loss),
        "burst_messages_mean": max(1.0, _rounded(burst)),
    }
    return (
        {"loss": table},
        [
            Estimate.normal("loss.loss_ratio", loss, loss_error, 0.0, 1.0),
            Estimate.normal("loss.burst_messages_mean", burst, burst_error, 1.0),
            Estimate.normal("loss.good_to_bad_ratio", p, sqrt(variance_p), 0.0, 1.0),
            Estimate.normal("loss.bad_to_good_ratio", r, sqrt(variance_r), 0.0, 1.0),
        ],
        [],
    )


def _incomplete_burst(judged: Flags, lost: Flags) -> FittedKeys:
    """Fit a chain without a complete burst, whose length is known only so far."""
    losses, count = int(lost.sum()), int(judged.sum())
    burst = float(bursts(lost[judged]).max())
    interval = share(losses, count, CONFIDENCE, inflation(losses / count, burst))
    table = {
        "kind": "gilbert_elliott",
        "loss_ratio": _rounded(interval.value),
        "burst_messages_mean": burst,
    }
    error = 0.5 * (interval.high - interval.low)
    return (
        {"loss": table},
        [Estimate("loss.loss_ratio", interval.value, error, interval.low, interval.high)],
        [],
    )


def _collisions(link: RecordedLink) -> FittedKeys:
    """Fit persistent collisions to their mean burst, for reservations of the typical length.

    With loss ratio p and probability q of keeping a resource, the reservation after a colliding one
    collides with probability c = q + (1 - q) p. The mean burst has 10 / (1 - c) messages.
    """
    judged, lost = judged_by(link, "collision")
    if not lost.any():
        return {}, [], []
    loss, burst, loss_error, burst_error = _share_and_burst(judged, lost)
    again = max(0.0, 1.0 - TYPICAL_RESERVATION / burst)
    kept = min(0.99, max(0.0, (again - loss) / (1.0 - loss))) if loss < 1.0 else 0.0
    kept_error = TYPICAL_RESERVATION * burst_error / (burst * burst * max(1.0 - loss, 1e-9))
    return (
        {"collisions": {"loss_ratio": _rounded(loss), "keep_ratio": _rounded(kept)}},
        [
            Estimate.normal("collisions.loss_ratio", loss, loss_error, 0.0, 1.0),
            Estimate.normal("collisions.keep_ratio", kept, kept_error, 0.0, 0.99),
        ],
        [],
    )


def _share_and_burst(judged: Flags, lost: Flags) -> tuple[float, float, float, float]:
    """Loss ratio and mean burst, with their standard errors."""
    judged_lost = lost[judged]
    lengths, count = bursts(judged_lost), len(judged_lost)
    loss, burst = float(judged_lost.mean()), float(lengths.mean())
    variance_ratio = inflation(loss, burst)
    deviation = max(float(lengths.std()), sqrt(burst * (burst - 1.0)))
    return (
        loss,
        burst,
        sqrt(loss * (1 - loss) / count * variance_ratio),
        deviation / sqrt(len(lengths)),
    )


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


FITTERS: Mapping[str, Callable[[RecordedLink], FittedKeys]] = {
    "rate_hz": _rate,
    "outages": _outages,
    "loss_ratio": _independent,
    "loss": _bursts,
    "collisions": _collisions,
    "radio": lambda link: fit_radio(link, *judged_by(link, "range")),
}
"""Functions that fit the laws of a link, by key."""


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
    delay: str
    notes: tuple[str, ...] = ()
    log_faults: str = ""
    """Damage and holes of the log in one line: messages without a verdict are not fitted."""

    @property
    def entry(self) -> dict[str, Any]:
        return {"sender": self.sender, "receiver": self.receiver, **self.keys}


def fit_link(link: RecordedLink, log_faults: str = "") -> FittedLink:
    loss_keys, estimates, notes = fit_losses(link)
    delivered = link.delivered
    chosen = delivered if delivered.any() else ~delivered
    delay = fit_delay(link.number[chosen], link.sent_at_s[chosen], link.delay_ms[chosen])
    return FittedLink(
        sender=link.sender,
        receiver=link.receiver,
        messages=len(link.number),
        keys={**loss_keys, **delay.keys},
        estimates=(*estimates, *delay.estimates),
        delay=delay.description,
        notes=tuple(notes),
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
