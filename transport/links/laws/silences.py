"""How often a link is silent for longer than a limit though its sender sends: false alarms.

A silence begins with a message that is heard and lasts until a newer one is. It is an alarm if at
an instant of control nothing newer was heard for longer than the limit; so it is known which
messages, counted from the one that was heard, all have to be lost. The chance of that is a product
of matrices where losses follow a Markov chain, exact however rare it is.

Losses are taken as independent of delays, and delays as independent of one another.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import ceil, exp, floor, fsum, inf, lcm

import numpy as np

from transport.links.laws.chains import FourState, GilbertElliott
from transport.links.laws.effect import Effect
from transport.links.laws.outages import RandomOutage
from transport.links.laws.plain import Loss
from vehicles.schedule import SECOND, instant

MOST_NUMBERS = 200_000
"""Numbers of messages that are looked at one by one, where losses are a matter of numbers."""
MOST_PHASES = 1000
"""Phases between sending and control that are looked at; more are like these."""
LONGEST_TAIL = 20_000
"""Messages after which a silence that has not ended counts as endless."""
_ENDED = 1e-9
"""Share of silences that need not be followed to their end."""

Vector = tuple[float, ...]
MayPass = Callable[[int], bool]
"""Whether the message of a number is carried, and not lost for sure."""


@dataclass(frozen=True, slots=True)
class LossChain:
    """Losses of messages as a stationary Markov chain that steps with each message.

    `rows[i][j]` is the chance from state i to j, `shares` are those of the messages that find the
    chain in each state, and `loses` is the chance of a loss in it.
    """

    rows: tuple[Vector, ...]
    shares: Vector
    loses: Vector

    def beside(self, other: "LossChain") -> "LossChain":
        """Both laws together, each on its own."""
        return LossChain(
            tuple(
                tuple(a * b for a in mine for b in theirs)
                for mine in self.rows
                for theirs in other.rows
            ),
            tuple(a * b for a in self.shares for b in other.shares),
            tuple(1.0 - (1.0 - a) * (1.0 - b) for a in self.loses for b in other.loses),
        )

    def step(self, weights: Vector, unheard: Vector) -> Vector:
        """Weights of the states after the next message, if nothing is heard of it.

        Summed exactly, so that they are the same on every machine.
        """
        return tuple(
            fsum(weight * row[to] for weight, row in zip(weights, self.rows, strict=True)) * factor
            for to, factor in enumerate(unheard)
        )

    def unheard(self, heard: float) -> Vector:
        """Chance in each state that a message is not heard; `heard` is that it is, if it passes."""
        return tuple(1.0 - heard * (1.0 - loses) for loses in self.loses)

    def dispersion(self, heard: Vector) -> float:
        """Variance over mean of the number of silences in the long run; 1 for a Poisson number.

        Each begins with a message that passes, of which none follows for as many as are in `heard`
        (the chances that they are heard if they pass). So two do not overlap; beyond that the
        fundamental matrix Z sums up what one tells of later ones (Kemeny and Snell, Finite Markov
        Chains, 1960, section 4.3).
        """
        rows, shares = np.array(self.rows), np.array(self.shares)
        passes = 1.0 - np.array(self.loses)
        silent = np.eye(len(shares))
        for chance in heard:
            silent = silent @ (rows * np.array(self.unheard(chance)))
        begins = passes * silent.sum(axis=1)
        rate = float(shares @ begins)
        if not rate:
            return 1.0
        after = (shares * passes) @ silent
        one = np.eye(len(shares))
        fundamental = np.linalg.inv(one - rows + np.outer(np.ones(len(shares)), shares))
        later = float(after @ (fundamental - one) @ begins)
        return 1.0 - rate - 2.0 * len(heard) * rate + 2.0 * later / rate


SURE = LossChain(((1.0,),), (1.0,), (0.0,))
"""Nothing is lost by chance."""


def loss_chain(effect: Effect, period_ns: float) -> LossChain | None:
    """The chain of a law, of messages sent every `period_ns`; None if it is none of a few states.

    A random outage has two: the chance that it is as it was falls by the rate of its instants.
    """
    if isinstance(effect, Loss):
        return LossChain(((1.0,),), (1.0,), (effect.ratio,))
    if isinstance(effect, GilbertElliott | FourState):
        rows = tuple(tuple(map(float, row)) for row in effect.chain.rows)
        return LossChain(rows, tuple(map(float, effect.chain.shares)), effect.loses)
    if isinstance(effect, RandomOutage):
        off = effect.mean_loss_ratio
        kept = exp(-period_ns * (1.0 / effect.mean_on + 1.0 / effect.mean_off))
        shares = (off, 1.0 - off)
        rows = tuple(
            tuple(share * (1.0 - kept) + kept * (i == j) for j, share in enumerate(shares))
            for i in range(2)
        )
        return LossChain(rows, shares, (1.0, 0.0))
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Listening:
    """When messages are sent and when a receiver listens and judges; spans in ns.

    Message k is sent `phase` after the k-th instant of `rate_hz`, and under way for one of
    `delays`, each as likely as the others, in order of size. The receiver listens at the instants
    of all of `listens_hz`, and judges at those of `control_hz`: it is an alarm when nothing newer
    was heard for more than `limit`.
    """

    rate_hz: float
    phase: int
    delays: tuple[int, ...]
    control_hz: float
    listens_hz: tuple[float, ...]
    limit: int

    def sent_at(self, number: int) -> int:
        """Instant at which a message is sent."""
        return self.phase + instant(0, number, self.rate_hz)

    @property
    def mean_delay(self) -> int:
        """Mean of the delays."""
        return round(fsum(self.delays) / len(self.delays))

    def heard_at(self, visible_at: int) -> int:
        """First instant of listening at which a message is there."""
        return min(_first_from(visible_at, rate) for rate in (self.control_hz, *self.listens_hz))

    def alarm_at(self, heard_at: int) -> int:
        """First instant of control at which nothing was heard for more than the limit."""
        return _first_from(heard_at + self.limit + 1, self.control_hz)

    def phases(self) -> int:
        """After how many messages sending and control are as they were."""
        rates = (Fraction(rate).limit_denominator(1000) for rate in self._rates)
        ratios = [Fraction(self.rate_hz).limit_denominator(1000) / rate for rate in rates]
        return min(lcm(*(ratio.numerator for ratio in ratios)), MOST_PHASES)

    @property
    def _rates(self) -> tuple[float, ...]:
        return (self.control_hz, *self.listens_hz)


def _first_from(at: int, rate_hz: float) -> int:
    """First instant of a schedule of `rate_hz` at or after an instant."""
    k = max(floor(at * rate_hz / SECOND) - 1, 0)
    while (found := instant(0, k, rate_hz)) < at:
        k += 1
    return found


@dataclass(frozen=True, slots=True)
class Silences:
    """Alarms of a link: how many, and how long nothing was heard beyond them altogether (ns)."""

    alarms: float
    silent_ns: float


@dataclass(slots=True)
class SilenceLaw:
    """Silences of a link: its losses by chance, and which messages it carries at all."""

    chain: LossChain
    listening: Listening
    may_pass: MayPass
    _known: dict[Vector, Vector] = field(default_factory=dict)

    def after(self, number: int) -> float:
        """Chance that a message is heard and an alarm follows."""
        if not self.may_pass(number):
            return 0.0
        sent_at, delays = self.listening.sent_at(number), self.listening.delays
        chances = (fsum(self._after(number, sent_at + delay)[0]) for delay in delays)
        return fsum(chances) / len(delays)

    def silent_after(self, number: int) -> float:
        """How long (ns) nothing is heard beyond that alarm on average, times the chance of it.

        As if the message that is heard, and the one that ends the silence, had the mean delay.
        """
        if not self.may_pass(number):
            return 0.0
        visible_at = self.listening.sent_at(number) + self.listening.mean_delay
        return self._silent(*self._after(number, visible_at))

    def _after(self, number: int, visible_at: int) -> tuple[Vector, int, int]:
        """Weights of the states at the alarm, the next message's number, and the alarm's instant.

        That after a message that is there at an instant.
        """
        alarm_at = self.listening.alarm_at(self.listening.heard_at(visible_at))
        heard = self._heard_by(alarm_at, number + 1)
        return self._unheard(heard), number + 1 + len(heard), alarm_at

    def _heard_by(self, alarm_at: int, number: int) -> Vector:
        """Chances that a message and those behind it are there by an instant, if not lost."""
        heard: list[float] = []
        delays = self.listening.delays
        while True:
            following = number + len(heard)
            by_then = bisect_right(delays, alarm_at - self.listening.sent_at(following))
            if not by_then:
                return tuple(heard)
            heard.append(by_then / len(delays) if self.may_pass(following) else 0.0)

    def _unheard(self, heard: Vector) -> Vector:
        """Weights of the states after a message that passes and others, none of which is heard."""
        known = self._known.get(heard)
        if known is None:
            chain = self.chain
            known = tuple(
                share * (1.0 - loses)
                for share, loses in zip(chain.shares, chain.loses, strict=True)
            )
            for chance in heard:
                known = chain.step(known, chain.unheard(chance))
            self._known[heard] = known
        return known

    def _silent(self, weights: Vector, number: int, alarm_at: int) -> float:
        """Mean time (ns) from an alarm until a message from `number` on is heard, times chance."""
        begun = left = fsum(weights)
        silent, since, delay = 0.0, alarm_at, self.listening.mean_delay
        for following in range(number, number + LONGEST_TAIL):
            if left <= _ENDED * begun:
                return silent
            there_at = self.listening.heard_at(self.listening.sent_at(following) + delay)
            silent += left * max(there_at - since, 0)
            since = max(there_at, since)
            passes = float(self.may_pass(following))
            weights = self.chain.step(weights, self.chain.unheard(passes))
            left = fsum(weights)
        return inf

    def of_run(self, messages: int, repeats: int | None) -> float | None:
        """Alarms to be expected while so many messages are sent, the first of them number 0.

        What the link carries is the same again after `repeats` messages, None if never: then each
        message is looked at, and None is the answer where they are too many.
        """
        listening = self.listening
        latest = listening.alarm_at(listening.heard_at(listening.sent_at(0) + listening.delays[-1]))
        left = listening.sent_at(messages) - latest
        count = max(ceil(left * listening.rate_hz / SECOND), 0)
        looked = count
        if repeats is not None:
            looked = min(lcm(repeats, listening.phases()), count)
        if looked > MOST_NUMBERS:
            return None
        return fsum(map(self.after, range(looked))) * (count / looked if looked else 0.0)

    def in_the_long_run(self, repeats: int) -> Silences | None:
        """Alarms for each message sent, of a link that carries the same after `repeats` again."""
        looked = lcm(repeats, self.listening.phases())
        if looked > MOST_NUMBERS:
            return None
        return Silences(
            fsum(map(self.after, range(looked))) / looked,
            fsum(map(self.silent_after, range(looked))) / looked,
        )

    def dispersion(self) -> float:
        """By how much the number of alarms varies more than a Poisson number, at least 1."""
        listening = self.listening
        alarm_at = listening.alarm_at(
            listening.heard_at(listening.sent_at(0) + listening.delays[0])
        )
        return max(self.chain.dispersion(self._heard_by(alarm_at, 1)), 1.0)


def counted_silences(there: Iterable[tuple[int, int]], listening: Listening) -> Silences:
    """Count the alarms of messages that came: number and when each was there (ns), in any order.

    A silence that has no end is not counted.
    """
    newest, heard_at, alarms, silent = -1, None, 0, 0
    for visible_at, number in sorted((visible_at, number) for number, visible_at in there):
        if number < newest:
            continue
        now = listening.heard_at(visible_at)
        if heard_at is not None and now > (alarm_at := listening.alarm_at(heard_at)):
            alarms, silent = alarms + 1, silent + now - alarm_at
        newest, heard_at = number, now
    return Silences(float(alarms), float(silent))


def both_silent(one: Silences, other: Silences) -> float:
    """How often a second two links fall silent together, each on its own, of what each does.

    One falls silent while the other is: the rate of the first times the share of time in which the
    second is silent, and the other way round.
    """
    return (one.alarms * other.silent_ns + other.alarms * one.silent_ns) / SECOND


def quantiles(values: Sequence[int], count: int) -> tuple[int, ...]:
    """So many equally likely values that stand for a sorted list of them."""
    return tuple(values[(2 * k + 1) * len(values) // (2 * count)] for k in range(count))
