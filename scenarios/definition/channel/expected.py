"""Expected loss, bursts, delay and age of a link, as far as its laws determine them."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from math import gcd, inf, prod, sqrt

from scenarios.definition.channel.build import Between, link_effects, link_stages
from scenarios.definition.schema.link_tables import LinkTable
from transport.links.laws.effect import Effect
from transport.links.laws.moments import Losses
from transport.links.laws.vehicles_between import no_vehicles
from vehicles.schedule import MILLISECOND

USUAL_MESSAGE_BYTES = 240
"""Mean size of poses with the default path history; without a history they have 160 bytes."""
FASTEST_HZ = 1000.0
"""Highest rate of a source, so that the rate of a link is always an upper bound."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedChannel:
    """Long-run mean loss, mean burst, mean and standard deviation of the delay (ms).

    Unknown figures are None, such as a loss that depends on the distance.

    `loss_inflation` and `latency_inflation` are upper bounds of the variance of a counted loss and
    of a mean delay, over that of independent messages. `settles` is False where messages are lost
    by number or for a time, so that a run differs from the long run.
    """

    loss_ratio: float | None
    burst_messages: float | None
    latency_ms_mean: float | None
    latency_ms_deviation: float | None
    loss_inflation: float = 1.0
    latency_inflation: float = 1.0
    settles: bool = True


def expected_channel(
    table: LinkTable,
    source_rate_hz: float = FASTEST_HZ,
    distance_m: float | None = None,
    between: Between = no_vehicles,
) -> ExpectedChannel:
    """Combine the laws of a link, assumed independent.

    Messages are sent at `source_rate_hz` over `distance_m`, with all vehicles `between` obstructing
    the line of sight. Without a distance the loss of a radio is unknown. Times in which a vehicle's
    radio is off do not count.
    """
    effects = link_effects(table, source_rate_hz, between=between)
    loss = expected_loss(table, effects, distance_m)
    mean, deviation, inflation = _delay(table, effects)
    ratio, burst = (None, None) if loss is None else (loss.loss, loss.burst)
    if burst == inf:
        burst = None
    spread = ratio * (1.0 - ratio) if ratio else 0.0
    return ExpectedChannel(
        loss_ratio=ratio,
        burst_messages=burst if ratio else None,
        latency_ms_mean=mean,
        latency_ms_deviation=deviation,
        loss_inflation=max(1.0, 1.0 + 2.0 * loss.covariances / spread) if loss and spread else 1.0,
        latency_inflation=inflation,
        settles=not any(one.judged_by in {"number", "time"} for one in effects),
    )


def expected_loss(
    table: LinkTable, effects: Sequence[Effect], distance_m: float | None
) -> Losses | None:
    """Combine the losses of all laws: 1 - Π(1 - p); None if one is unknown."""
    if table.queue is not None:
        return None
    decimated = any(one.reason == "rate" for one in effects)
    if decimated and any(one.judged_by == "number" for one in effects):
        return None  # the rate selects messages by number as well
    result = [one.losses(distance_m) for one in effects]
    if table.content is not None:
        result.append(table.content.corrupted(USUAL_MESSAGE_BYTES))
    known = [one for one in result if one is not None]
    if len(known) < len(result):
        return None
    whole = reduce(Losses.beside, (one for one in known if one.loss), Losses(0.0, None, 0.0))
    if decimated and any(one.has_memory for one in known):
        return Losses(whole.loss, None, whole.covariances)  # memory counts omitted messages too
    return Losses(whole.loss, _burst(known, whole.loss), whole.covariances)


def _burst(laws: Sequence[Losses], loss: float) -> float | None:
    """Return the mean burst of several independent stationary laws.

    The rate of ending bursts is P(passes) - P(two in a row pass), products over the laws.
    """
    lossy = [one for one in laws if one.loss]
    together = [one.both_delivered for one in lossy]
    if not lossy or None in together:
        return None
    if len(lossy) == 1:
        return lossy[0].burst
    ends = (1.0 - loss) - prod(one for one in together if one is not None)
    return loss / ends if ends > _ROUNDING * loss else inf


def _delay(table: LinkTable, effects: Sequence[Effect]) -> tuple[float | None, float | None, float]:
    if link_stages(table):
        return None, None, 1.0
    mean = variance = spread = 0.0
    for effect in effects:
        delays = effect.delays
        if delays is None:
            return None, None, 1.0
        tied = delays.correlation
        mean, variance = mean + delays.mean, variance + delays.variance
        spread += delays.variance * (1.0 + tied) / (1.0 - tied)
    inflation = spread / variance if variance else 1.0
    return mean / MILLISECOND, sqrt(variance) / MILLISECOND, inflation


def expected_age_ms(
    expected: ExpectedChannel, rate_hz: float, control_rate_hz: float | None = None
) -> float | None:
    """Return the mean age (ms) of the newest message of a source at a rate; None if unknown.

    Without much overtaking it is the mean delay plus E[X²] / (2 E[X]) periods, where X is the
    number of periods between received messages (renewal theory: Cox 1962, section 5.2). Losses are
    modelled as a two-state chain with mean loss p and burst b: exact for independent losses, with
    delay + T (1 / (1 - p) - 1/2), and for Gilbert's law.

    Commands at `control_rate_hz` meet a constant delay in phases that are a greatest common divisor
    of both periods apart.
    """
    loss, delay = expected.loss_ratio, expected.latency_ms_mean
    if loss is None or delay is None or loss == 1.0:
        return None
    burst = expected.burst_messages if loss else 1.0
    if burst is None:
        return None
    begins, ends = loss / (burst * (1.0 - loss)), 1.0 / burst
    mean = 1.0 + begins / ends
    square = 1.0 + begins * (2.0 / ends + (2.0 - ends) / ends**2)
    age = delay + 1000.0 / rate_hz * 0.5 * square / mean
    if control_rate_hz is not None and not expected.latency_ms_deviation:
        step = 1000.0 * _common_period_s(Fraction(rate_hz), Fraction(control_rate_hz))
        age += -delay % step - 0.5 * step
    return age


def _common_period_s(one: Fraction, other: Fraction) -> float:
    """Return the greatest common divisor (s) of the periods of two rates (Hz)."""
    # gcd(a/b, c/d) = gcd(ad, cb) / bd, of the periods 1/one and 1/other
    a, b, c, d = one.denominator, one.numerator, other.denominator, other.numerator
    return gcd(a * d, c * b) / (b * d)
