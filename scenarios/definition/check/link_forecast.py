"""Rules, laws and expected figures of each directed link."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

from scenarios.definition.channel.build import link_effects, link_stages, vehicles_between
from scenarios.definition.channel.expected import expected_age_ms, expected_channel
from scenarios.definition.channel.origins import OF_VEHICLES, rules_of, source_key
from scenarios.definition.check.preview import spacing_to
from scenarios.definition.scenario import Scenario
from vehicles.schedule import MILLISECOND

PLAIN = {"rate_hz", "loss_ratio", "latency_ms", "jitter_ms"}


@dataclass(frozen=True, slots=True, kw_only=True)
class LawDescription:
    """Description of a law, and the key that sets it."""

    words: str
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkForecast:
    """Settings of one directed link, and its long-run figures.

    `rules` apply to the link, the most specific first. Figures that depend on more than the laws
    are None. Those of a radio are for `distance_m`, the spacing at the lead's first speed, with all
    vehicles in between obstructing it. `age_ms_mean` is the age of the newest message at a command,
    for periodic messages and losses of a two-state chain.
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


def link_forecasts(scenario: Scenario) -> tuple[LinkForecast, ...]:
    return tuple(link_forecast(scenario, link) for link in scenario.links)


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
    )


def laws_in_brief(scenario: Scenario, link: tuple[str, str]) -> str:
    """Describe the laws of a link except latency, jitter, independent loss and rate."""
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
