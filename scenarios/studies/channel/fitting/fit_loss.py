"""The losses of a link from recorded fates: each law by the messages that it had to judge.

A log says by which law a message was dropped. Laws judge in the order of ORDER, and the first that
drops a message names the reason; so a law is estimated from what no earlier one dropped. For it
those dropped earlier are unknown, and what later ones dropped has passed it.
"""

from collections.abc import Callable, Mapping
from fractions import Fraction
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenarios.results.channel.estimates import CONFIDENCE, bursts, inflation, share
from scenarios.studies.channel.fitting.estimate import Estimate
from scenarios.studies.channel.fitting.fit_radio import FittedKeys, fit_radio
from scenarios.studies.channel.fitting.recorded import RecordedLink
from transport.links.laws.registry import KEY_OF_REASON

Flags = NDArray[np.bool_]

REASON_ORDER = tuple(KEY_OF_REASON)
"""Reasons in the order in which the effects of a link judge."""
OUTAGE_NOTE = "outages as times: one drive does not tell whether places are behind them"
OUTAGES = ("outage", "transmitter_off", "receiver_off")
TYPICAL_RESERVATION = 10.0
"""Messages of a reservation of LTE-V2X on average, 5 to 15 at 10 Hz (3GPP TS 36.321)."""


def fit_losses(link: RecordedLink) -> FittedKeys:
    """Fit all laws of loss of a link: keys, estimates, and what the log leaves open."""
    keys: dict[str, Any] = {}
    estimates: list[Estimate] = []
    notes: list[str] = []
    for fitter in FITTERS.values():
        more, found, noted = fitter(link)
        keys |= more
        estimates += found
        notes += noted
    return keys, estimates, notes


def judged_by(link: RecordedLink, *reasons: str) -> tuple[Flags, Flags]:
    """Which messages a law with the reasons `words` judged, and which of all it dropped."""
    earlier = REASON_ORDER[: min(REASON_ORDER.index(word) for word in reasons)]
    dropped: Flags = np.isin(link.reason, reasons)
    judged: Flags = ~np.isin(link.reason, [word for word in earlier if word not in reasons])
    return judged, dropped


def _rate(link: RecordedLink) -> FittedKeys:
    skipped = link.reason == "rate"
    if not skipped.any() or not link.period_s:
        return {}, [], []
    carried = Fraction(float(1.0 - skipped.mean())).limit_denominator(100)
    rate_hz = float(carried) / link.period_s
    step = 1.0 / (len(skipped) * link.period_s)
    value = float(f"{rate_hz:.6g}")
    return {"rate_hz": value}, [Estimate("rate_hz", value, step, value - step, value + step)], []


def _outages(link: RecordedLink) -> FittedKeys:
    """Windows of time from the first message that was held back to the first that was not."""
    off = np.isin(link.reason, OUTAGES)
    if not off.any():
        return {}, [], []
    known = off | (link.reason != "rate")
    off, sent_at = off[known], link.sent_at_s[known]
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off, [False])).astype(np.int8)))
    windows, estimates = [], []
    last = float(sent_at[-1]) + link.period_s
    for place, (first, after) in enumerate(zip(edges[::2], edges[1::2], strict=True)):
        from_s = float(sent_at[first])
        to_s = float(sent_at[after]) if after < len(sent_at) else last
        windows.append({"kind": "window", "from_s": round(from_s, 6), "to_s": round(to_s, 6)})
        for key, at in (("from_s", from_s), ("to_s", to_s)):
            low = max(0.0, at - link.period_s)
            estimates.append(Estimate(f"outages[{place}].{key}", at, link.period_s, low, at))
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
    """Count pairs of messages: first delivered, of these then lost; first lost, then delivered."""
    pairs = (np.diff(link.number) == 1) & judged[1:] & judged[:-1]
    before, after = lost[:-1][pairs], lost[1:][pairs]
    return (
        int((~before).sum()), int((~before & after).sum()),
        int(before.sum()), int((before & ~after).sum()),
    )  # fmt: skip


def _bursts(link: RecordedLink) -> FittedKeys:
    """Gilbert's chain from its transitions, which are binomial, and so are their errors."""
    judged, lost = judged_by(link, "burst", "pattern")
    if not lost.any():
        return {}, [], []
    good, worsened, bad, recovered = _transitions(link, judged, lost)
    if not worsened or not recovered:  # one burst alone, or no end of it
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
    """A chain without a complete burst: only its length so far is known."""
    count, of = int(lost.sum()), int(judged.sum())
    burst = float(bursts(lost[judged]).max())
    interval = share(count, of, CONFIDENCE, inflation(count / of, burst))
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
    """Persistent collisions by their mean burst, for reservations of the usual length.

    With the share p lost and the chance q of keeping a resource, a colliding reservation is
    followed by another with c = q + (1 - q) p, and a burst has 10 / (1 - c) messages.
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
    """Share lost and mean burst, with their standard errors."""
    of = lost[judged]
    lengths, count = bursts(of), len(of)
    loss, burst = float(of.mean()), float(lengths.mean())
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
"""Functions that fit the laws of a link, by its keys."""
