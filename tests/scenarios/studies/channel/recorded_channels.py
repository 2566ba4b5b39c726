"""Recorded links made without a run, on a long drive whose gaps grow and shrink."""

from collections.abc import Iterable
from functools import partial

import numpy as np

from scenarios.definition.channel.build import link_effects, link_stages, vehicles_between
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.studies.channel.recorded import RecordedLink
from transport.links.inbox import judge_stream
from transport.links.laws.link_law import Position, TransmissionContext
from transport.links.link import Link
from vehicles.schedule import MILLISECOND, SECOND

RATE_HZ = 20.0
SPEED_MPS = 30.0
NEAREST_M, FARTHEST_M = 10.0, 160.0
"""Range of the distance between neighbouring cars."""
PERIOD_S = 200.0
SIZE = 120
STRAIGHT = """
name = "long"
duration_s = 2000.0
[convoy]
vehicles = 4
gap_m = 5.0
[speed]
lead = "set"
set_mps = 30.0
[path]
kind = "segments"
segments = [{ length_m = 70000.0 }]
"""


def long_drive(links: str) -> Scenario:
    return scenario_from_text(f"{STRAIGHT}\n{links}")


def recorded_links_of(
    scenario: Scenario, messages: int, seed: int, pairs: Iterable[tuple[str, str]] = ()
) -> tuple[RecordedLink, ...]:
    """Judge `messages` on each link of `pairs`, by default on all links."""
    chosen = tuple(pairs) or tuple(scenario.links)
    return tuple(_recorded(scenario, pair, messages, seed) for pair in chosen)


def _recorded(scenario: Scenario, pair: tuple[str, str], messages: int, seed: int) -> RecordedLink:
    places = [scenario.vehicle_names.index(name) for name in pair]
    between = partial(vehicles_between, scenario.route, *places)
    table = scenario.links[pair]
    effects = link_effects(table, RATE_HZ, scenario.link_setting(*pair, 0), between)
    link = Link(effects, seed, *pair, link_stages(table))
    sent_at = [round(k * SECOND / RATE_HZ) for k in range(messages)]
    sender_m, receiver_m = (_driven(place, np.array(sent_at) / SECOND) for place in places)
    apart = (places[1] - places[0]) * NEAREST_M
    stream = [
        TransmissionContext(
            k, at, SIZE, Position(sender + apart, 0.0, sender), Position(own, 0.0, own)
        )
        for k, (at, sender, own) in enumerate(zip(sent_at, sender_m, receiver_m, strict=True))
    ]
    judged = judge_stream(link, stream)
    return RecordedLink(
        *pair,
        number=np.arange(messages),
        sent_at_s=np.array(sent_at) / SECOND,
        delay_ms=(np.array([verdict.visible_at for verdict in judged]) - sent_at) / MILLISECOND,
        distance_m=np.abs(sender_m + apart - receiver_m),
        reason=np.array([verdict.reason for verdict in judged], dtype=np.str_),
    )


def _driven(
    place: int, at_s: "np.ndarray[tuple[int], np.dtype[np.float64]]"
) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """Distance (m) driven by a vehicle while gaps grow and shrink linearly."""
    phase = at_s / PERIOD_S % 1.0
    gap = (FARTHEST_M - NEAREST_M) * (1.0 - np.abs(2.0 * phase - 1.0))
    return SPEED_MPS * at_s - place * gap
