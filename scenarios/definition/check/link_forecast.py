"""A sample of a directed link by the effects of a run, on a straight road.

Both ends drive at one speed and distance; vehicles in between are evenly spaced in the line of
sight. Messages are periodic and of one size.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.channel.build import (
    USUAL_MESSAGE_BYTES,
    link_effects,
    link_stages,
)
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.link_tables import LinkTable
from transport.links.inbox import judge_stream
from transport.links.laws.link_law import (
    Effect,
    Position,
    Road,
    TransmissionContext,
    VehiclesBetween,
)
from transport.links.link import Link
from transport.topics import counts_as_loss
from vehicles.schedule import MILLISECOND, SECOND

SLOWEST_MPS = 1.0
"""Smallest speed (m/s), since shadowing changes with the distance driven."""


@dataclass(frozen=True, slots=True)
class SampledChannel:
    """Fate of the messages of a link: lost by number, and delays (ms) of the others."""

    lost: NDArray[np.bool_]
    delay_ms: NDArray[np.float64]
    dropped: Counter[str]


@dataclass(frozen=True, slots=True)
class StraightDrive:
    """A link of a scenario on a straight road, at a distance (m)."""

    scenario: Scenario
    link: tuple[str, str]
    distance_m: float

    @property
    def table(self) -> LinkTable:
        return self.scenario.links[self.link]

    @property
    def rate_hz(self) -> float:
        """Messages per second, the highest rate if it changes."""
        sender = self.scenario.vehicle(self.link[0])
        return sender.highest_rate_hz

    @property
    def speed_mps(self) -> float:
        profile, duration_s = self.scenario.route.profile, self.scenario.duration_s
        return max(profile.distance(duration_s) / duration_s, SLOWEST_MPS)

    def between(self) -> VehiclesBetween:
        places = [self.scenario.vehicle(name).place for name in self.link]
        straight = Road(1.0, (0.0, 1.0), (0.0, 0.0))
        return VehiclesBetween(max(places[1] - places[0] - 1, 0), straight, self.distance_m, 0.0)

    def effects(self) -> tuple[Effect, ...]:
        setting = self.scenario.link_setting(*self.link, 0)
        return link_effects(self.table, self.rate_hz, setting, self.between)

    def sample(self, messages: int) -> SampledChannel:
        lost, delays = list[bool](), list[float]()
        dropped: Counter[str] = Counter()
        for context, visible_at, reason in self._judged(messages):
            if reason:
                dropped[reason] += 1
            if not reason or counts_as_loss(reason):
                lost.append(bool(reason))
            if not reason:
                delays.append((visible_at - context.sent_at) / MILLISECOND)
        return SampledChannel(np.array(lost, dtype=np.bool_), np.array(delays), dropped)

    def _judged(self, messages: int) -> Iterator[tuple[TransmissionContext, int, str]]:
        """Yield each message, its time of arrival (ns), and the reason of its drop."""
        stages = link_stages(self.table)
        link = Link(self.effects(), self.scenario.seed, *self.link, stages)
        contexts, content = list(self._contexts(messages)), self.table.content
        errors = content.bit_errors if content and content.frame_check else None
        for context, verdict in zip(contexts, judge_stream(link, contexts), strict=True):
            reason: str = verdict.reason
            if not reason and errors and errors.flips(link.draw, context.seq, context.size):
                reason = "corrupted"
            yield context, verdict.visible_at, reason

    def _contexts(self, messages: int) -> Iterator[TransmissionContext]:
        rate_hz, speed_mps = self.rate_hz, self.speed_mps
        for seq in range(messages):
            sent_at = round(seq * SECOND / rate_hz)
            driven = speed_mps * sent_at / SECOND
            ahead = Position(self.distance_m + driven, 0.0, driven)
            yield TransmissionContext(
                seq, sent_at, USUAL_MESSAGE_BYTES, ahead, Position(driven, 0.0, driven)
            )
