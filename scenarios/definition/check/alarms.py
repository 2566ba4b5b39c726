"""How often a follower counts a source as lost though its sender sends: false alarms.

By closed form where the losses of the link are those of Markov chains or a matter of numbers;
otherwise from a sample, drawn by the effects of a run.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from math import inf, lcm

from scenarios.definition.channel.build import link_effects
from scenarios.definition.channel.delay import link_stages
from scenarios.definition.channel.expected import USUAL_MESSAGE_BYTES
from scenarios.definition.channel.reach import loss_over_distance
from scenarios.definition.check.preview import gap_to
from scenarios.definition.check.sample import StraightDrive
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.links import LinkTable
from scenarios.definition.sending import even_rate_hz, link_rate_hz
from scenarios.definition.vehicle_setup import VehicleSetup
from transport.links.laws.content import BitErrors, Reordering
from transport.links.laws.delay import ConstantDelay, DrawnDelay
from transport.links.laws.effect import Described, Effect, Passage
from transport.links.laws.normals import quantile
from transport.links.laws.outages import CircleOutage, StretchOutage, TimedOutage
from transport.links.laws.patterns import EveryNth, Listed, RecordedPattern
from transport.links.laws.plain import Decimation, Jitter, Latency, Loss
from transport.links.laws.radio.delivery import DeliveryOverDistance
from transport.links.laws.silences import (
    SURE,
    Listening,
    LossChain,
    SilenceLaw,
    Silences,
    both_silent,
    counted_silences,
    loss_chain,
    quantiles,
)
from vehicles.schedule import SECOND

HOUR_S = 3600.0
DELAYS = 20
"""Equally likely delays that stand for a law of them."""
MOST_REPEATS = 10_000
"""Messages after which what is lost by number may come again, for the long run."""
SAMPLED = 20_000
"""Messages of a sample, where no closed form is known."""
BY_NUMBER = Decimation, EveryNth, Listed, RecordedPattern, TimedOutage


@dataclass(frozen=True)
class FalseAlarms:
    """What a link's laws say of false alarms; a silence of more than `limit_s` counts as one.

    `in_the_long_run` gives those for each message sent, None where no number says them, or losses
    by number never come again; `of_run` their number in a run of so many messages, `dispersion` by
    how much it varies more than a Poisson number.
    """

    limit_s: float
    sent_hz: float
    in_the_long_run: Callable[[], Silences | None]
    of_run: Callable[[int], float | None]
    dispersion: float = 1.0

    @cached_property
    def silences(self) -> Silences | None:
        """What is expected for each message sent; worked out when it is asked for."""
        return self.in_the_long_run()

    @property
    def per_h(self) -> float | None:
        """Alarms per hour in the long run."""
        if self.silences is None:
            return None
        return self.silences.alarms * self.sent_hz * HOUR_S


def _unknown(*_: object) -> None:
    return


def longest_silence_s(source: VehicleSetup, receiver: VehicleSetup) -> float:
    """Silence (s) beyond which a receiver counts a source as lost."""
    table = receiver.steering.degradation
    return max(table.lost_periods / link_rate_hz(source.sending, source.gnss), table.lost_s)


def listening(scenario: Scenario, link: tuple[str, str], delays: tuple[int, ...]) -> Listening:
    """When messages of a link (sender, receiver) are sent and judged."""
    source, setup = (scenario.vehicle(name) for name in link)
    rate_hz = link_rate_hz(source.sending, source.gnss)
    phase_s = getattr(source.sending, "phase_s", 0.0) + source.gnss.latency_ms / 1000.0
    return Listening(
        rate_hz=rate_hz,
        phase=round(phase_s * SECOND),
        delays=delays,
        control_hz=scenario.control_rate_hz,
        listens_hz=(setup.gnss.rate_hz,),
        limit=round(longest_silence_s(source, setup) * SECOND),
    )


def first_distance_m(scenario: Scenario, link: tuple[str, str]) -> float:
    """How far apart sender and receiver of a link drive at first."""
    sender, receiver = link
    speed = scenario.route.profile.at(0.0)[0]
    return gap_to(scenario, scenario.vehicle(receiver).place, sender, speed)


def false_alarms(
    scenario: Scenario, link: tuple[str, str], distance_m: float | None = None
) -> FalseAlarms:
    """Work out the false alarms of a link (sender, receiver), by closed form.

    Those of a radio whose messages are lost each on its own are known over a distance.
    """
    effects = _effects(scenario, link)
    delays = _delays(effects)
    heard = listening(scenario, link, delays or (0,))
    limit_s = heard.limit / SECOND
    chain = _chain(scenario.links[link], effects, heard, distance_m)
    if chain is None or delays is None or not _is_even(scenario.vehicle(link[0])):
        return FalseAlarms(limit_s, heard.rate_hz, _unknown, _unknown)
    by_number = [one for one in effects if isinstance(one, BY_NUMBER)]

    @cache
    def may_pass(number: int) -> bool:
        passage = Passage(number, heard.sent_at(number))
        return not any(isinstance(one.judge(_no_draw, passage), str) for one in by_number)

    law = SilenceLaw(chain, heard, may_pass)
    repeats = _repeats(by_number, heard)
    return FalseAlarms(
        limit_s,
        heard.rate_hz,
        lambda: None if repeats is None else law.in_the_long_run(repeats),
        lambda messages: law.of_run(messages, repeats),
        law.dispersion(),
    )


def sampled_alarms(
    scenario: Scenario, link: tuple[str, str], messages: int = SAMPLED
) -> Silences | None:
    """Count the alarms of a sample, for each message; None where it does not say them.

    Both ends drive on a straight road, as far apart as at first. Where the laws depend on when or
    where, or the sender does not send evenly, a sample says nothing.
    """
    effects = _effects(scenario, link)
    heard = listening(scenario, link, (0,))
    placed = any(isinstance(one, StretchOutage | CircleOutage) for one in effects)
    by_number = [one for one in effects if isinstance(one, BY_NUMBER)]
    if placed or not _is_even(scenario.vehicle(link[0])) or _repeats(by_number, heard) is None:
        return None
    drive = StraightDrive(scenario, link, first_distance_m(scenario, link))
    found = counted_silences(drive.arrivals(messages), heard)
    return Silences(found.alarms / messages, found.silent_ns / messages)


def deaf_per_h(found: Sequence[FalseAlarms]) -> float | None:
    """How often per hour a follower hears none of its sources, each silent on its own."""
    if any(one.silences is None for one in found):
        return None
    silences = [
        Silences(one.silences.alarms * one.sent_hz, one.silences.silent_ns * one.sent_hz)
        for one in found
        if one.silences is not None
    ]
    if len(silences) == 1:
        return silences[0].alarms * HOUR_S
    per_s = both_silent(*silences)
    return None if per_s == inf else per_s * HOUR_S


def _effects(scenario: Scenario, link: tuple[str, str]) -> tuple[Effect, ...]:
    source = scenario.vehicle(link[0])
    rate_hz = link_rate_hz(source.sending, source.gnss)
    return link_effects(scenario.links[link], rate_hz, scenario.link_setting(*link, 0))


def _is_even(source: VehicleSetup) -> bool:
    """Whether a message is sent each period, come what may."""
    gnss = source.gnss
    always = gnss.fix != "none" and not gnss.fix_states and not gnss.outages
    return always and even_rate_hz(source.sending, gnss) is not None


def _no_draw(purpose: str, seq: int) -> float:
    raise AssertionError(f"no chance in {purpose} of {seq}")


def _chain(
    table: LinkTable, effects: Sequence[Effect], heard: Listening, distance_m: float | None
) -> LossChain | None:
    """Losses by chance of all laws together, None if one of them is no chain."""
    if link_stages(table):
        return None
    found = [SURE]
    content = table.content
    if content is not None and content.bit_error_ratio and content.frame_check:
        corrupted = BitErrors(content.bit_error_ratio).corrupted_share(USUAL_MESSAGE_BYTES)
        effects = (*effects, Loss(corrupted))
    for effect in effects:
        if isinstance(effect, BY_NUMBER) or _only_delays(effect):
            continue
        law = effect
        is_radio = isinstance(effect, DeliveryOverDistance) and effect.reservations is None
        if is_radio and distance_m is not None:
            law = Loss(loss_over_distance(effect, distance_m)[0])
        chain = loss_chain(law, SECOND / heard.rate_hz)
        if chain is None:
            return None
        found.append(chain)
    return reduce(LossChain.beside, found)


def _only_delays(effect: Effect) -> bool:
    return isinstance(effect, Described) and effect.mean_loss_ratio == 0.0


def _delays(effects: Sequence[Effect]) -> tuple[int, ...] | None:
    """Equally likely delays of a message, in order; None where they depend on those before it."""
    known: tuple[int, ...] = (0,)
    for effect in effects:
        match effect:
            case Latency():
                more = [effect.floor]
            case Jitter():
                more = [round((k + 0.5) / DELAYS * effect.spread) for k in range(DELAYS)]
            case ConstantDelay():
                more = [effect.delay]
            case DrawnDelay() if not effect.normals.correlation:
                more = [round(effect.law.at(quantile((k + 0.5) / DELAYS))) for k in range(DELAYS)]
            case DrawnDelay() | Reordering():
                return None
            case _ if not _only_delays(effect) or isinstance(effect, Decimation):
                continue
            case _:
                return None
        both = sorted(one + other for one in known for other in more)
        known = quantiles(both, min(len(both), DELAYS))
    return known


def _repeats(by_number: Sequence[Effect], heard: Listening) -> int | None:
    """After how many messages what is lost by number comes again, None if never or too late."""
    found = 1
    for effect in by_number:
        match effect:
            case Decimation():
                found = lcm(found, effect.kept.denominator)
            case EveryNth():
                found = lcm(found, effect.period)
            case RecordedPattern() if effect.after_end == "repeat":
                found = lcm(found, effect.length)
            case _:
                return None
    return found if found * heard.phases() <= MOST_REPEATS else None
