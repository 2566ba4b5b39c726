"""What a scenario requests of each directed link: its rule, its laws, and their figures."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

from scenarios.definition.channel.build import link_effects, link_stages, vehicles_between
from scenarios.definition.channel.expected import expected_age_ms, expected_channel
from scenarios.definition.channel.origins import OF_VEHICLES, rules_of, source_key
from scenarios.definition.check.false_alarms import (
    Alarms,
    all_lost_per_h,
    longest_silence_s,
    sampled_alarms,
)
from scenarios.definition.check.preview import spacing_to
from scenarios.definition.scenario import Scenario
from vehicles.schedule import MILLISECOND

PLAIN = {"rate_hz", "loss_ratio", "latency_ms", "jitter_ms"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LawDescription:
    """The description of a law, and the key of the scenario that requests it."""

    words: str
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkForecast:
    """What is requested of one directed link, and what follows in the long run.

    `rules` are those about the link, the most specific first. Figures are None where they depend on
    more than the laws; those of a radio are for `distance_m`, that of the lead's first speed,
    with all vehicles in between in the way. `age_ms_mean` is that of the newest message at a
    command, where messages are sent evenly; losses are taken as those of a two-state chain.
    `false_alarms_per_h` is how often the receiver receives nothing from the sender for more than
    `silence_s_max`, and so counts it as lost, although it sends: counted in a sample.
    """

    sender: str
    receiver: str
    rules: tuple[str, ...]
    preset: str | None
    preset_source: str | None
    laws: tuple[LawDescription, ...]
    rate_hz: float
    distance_m: float | None
    loss_ratio: float | None
    burst_messages_mean: float | None
    latency_ms_mean: float | None
    latency_ms_deviation: float | None
    age_ms_mean: float | None
    silence_s_max: float
    false_alarms_per_h: float | None = field(compare=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverForecast:
    """How often per hour a follower counts all its sources as lost, although they send.

    That is if each link is silent on its own; None where no sample shows it.
    """

    receiver: str
    all_lost_per_h: float | None


def link_forecasts(
    scenario: Scenario,
) -> tuple[tuple[LinkForecast, ...], tuple[ReceiverForecast, ...]]:
    links: list[LinkForecast] = []
    of_receiver: dict[str, list[Alarms | None]] = {}
    samples: dict[LinkForecast, Alarms | None] = {}
    for link in scenario.links:
        asked = link_forecast(scenario, link)
        alike = replace(asked, sender="", receiver="")
        if alike not in samples:
            samples[alike] = sampled_alarms(scenario, link)
        found = samples[alike]
        links.append(replace(asked, false_alarms_per_h=None if found is None else found.per_h))
        if link[1] != scenario.vehicle_names[0]:  # the lead does not need what it receives
            of_receiver.setdefault(link[1], []).append(found)
    return tuple(links), tuple(
        ReceiverForecast(receiver=name, all_lost_per_h=all_lost_per_h(found))
        for name, found in of_receiver.items()
    )


def link_forecast(scenario: Scenario, link: tuple[str, str]) -> LinkForecast:
    sender, receiver = link
    table, source, setup = (
        scenario.links[link],
        scenario.vehicle(sender),
        scenario.vehicle(receiver),
    )
    speed = scenario.route.profile.at(0.0)[0]
    distance_m = spacing_to(scenario, setup.place, sender, speed) if table.radio else None
    between = partial(vehicles_between, scenario.route, source.place, setup.place)
    expected = expected_channel(table, source.highest_rate_hz, distance_m, between)
    if scenario.link_setting(sender, receiver, 0).off:
        expected = replace(expected, loss_ratio=None, burst_messages=None)
    sent_hz = source.usual_rate_hz(speed)
    rate_hz = min(sent_hz, table.rate_hz or sent_hz)
    age_ms = None
    if source.even_rate_hz is not None:
        age_ms = expected_age_ms(expected, rate_hz, scenario.control_rate_hz)
    return LinkForecast(
        sender=sender,
        receiver=receiver,
        rules=tuple(rules_of(scenario.tables, link)),
        preset=table.preset,
        preset_source=table.preset_source,
        laws=tuple(
            LawDescription(
                words=words, key=key if "." in key else source_key(scenario.tables, link, key)
            )
            for key, words in _laws(scenario, link)
        ),
        rate_hz=rate_hz,
        distance_m=distance_m,
        loss_ratio=expected.loss_ratio,
        burst_messages_mean=expected.burst_messages,
        latency_ms_mean=expected.latency_ms_mean,
        latency_ms_deviation=expected.latency_ms_deviation,
        age_ms_mean=None if age_ms is None else age_ms + source.gnss.latency / MILLISECOND,
        silence_s_max=longest_silence_s(source, setup),
        false_alarms_per_h=None,
    )


def laws_in_brief(scenario: Scenario, link: tuple[str, str]) -> str:
    """Name the laws of a link besides latency, jitter, independent loss and rate."""
    return "; ".join(words for key, words in _laws(scenario, link) if key not in PLAIN)


def _laws(scenario: Scenario, link: tuple[str, str]) -> Iterator[tuple[str, str]]:
    sender, receiver = link
    table, source = scenario.links[link], scenario.vehicle(sender)
    setting = scenario.link_setting(sender, receiver, 0)
    place = scenario.vehicle(receiver).place
    between = partial(vehicles_between, scenario.route, source.place, place)
    for effect in link_effects(table, source.highest_rate_hz, setting, between):
        end = OF_VEHICLES.get(effect.key)
        yield effect.key if end is None else f"vehicle.{link[end]}.{effect.key}", effect.describe()
    for stage in link_stages(table):
        yield stage.key, stage.describe()
    if table.content is not None:
        yield from ((table.content.key, words) for words in table.content.describe_content())
