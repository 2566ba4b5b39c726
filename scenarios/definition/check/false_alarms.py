"""False alarms: a follower counts a source as lost although it sends. Counted in a sample."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.check.link_sample import StraightDrive
from scenarios.definition.check.preview import spacing_to
from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.schedule import SECOND

HOUR_S = 3600.0
SAMPLED = 20_000
"""Number of messages in a sample."""
_ROUNDING = 1e-6

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Alarms:
    """False alarms of a link per second, and the share of time that the source counts as lost."""

    per_s: float
    lost_ratio: float

    @property
    def per_h(self) -> float:
        return self.per_s * HOUR_S


def longest_silence_s(source: VehicleSetup, receiver: VehicleSetup) -> float:
    """Return the silence (s) after which a receiver counts a source as lost."""
    return receiver.degradation.lost_after_silence(1.0 / source.highest_rate_hz)


def first_distance_m(scenario: Scenario, link: tuple[str, str]) -> float:
    sender, receiver = link
    speed = scenario.route.profile.at(0.0)[0]
    return spacing_to(scenario, scenario.vehicle(receiver).place, sender, speed)


def sampled_alarms(
    scenario: Scenario, link: tuple[str, str], messages: int = SAMPLED
) -> Alarms | None:
    """Count the false alarms of a link (sender, receiver) in a sample.

    Both ends drive on a straight road at their initial distance. None if losses depend on time or
    place, or messages are not periodic.
    """
    source, receiver = (scenario.vehicle(name) for name in link)
    drive = StraightDrive(scenario, link, first_distance_m(scenario, link))
    unlike = any(one.judged_by in {"time", "place"} for one in drive.effects())
    if unlike or not _is_even(source):
        return None
    limit_s = longest_silence_s(source, receiver)
    phase_s = (source.sending.first_send_delay + source.gnss.latency) / SECOND
    arrivals = [
        (number, phase_s + visible_at / SECOND) for number, visible_at in drive.arrivals(messages)
    ]
    rates_hz = scenario.control_rate_hz, receiver.gnss.rate
    beyond_s = times_beyond_limit(arrivals, limit_s, rates_hz)
    length_s = messages / drive.rate_hz
    return Alarms(len(beyond_s) / length_s, float(beyond_s.sum()) / length_s)


def times_beyond_limit(
    arrivals: Iterable[tuple[int, float]], limit_s: float, rates_hz: Sequence[float]
) -> Floats:
    """Return the time (s) that each silence of a link lasts beyond its alarm.

    `arrivals` are message numbers and times of arrival (s), in any order. The receiver reads them
    at the instants of all `rates_hz`, and judges at those of the first: an alarm is due after
    `limit_s` without a newer message. A silence without an end does not count.
    """
    ordered = sorted((at_s, number) for number, at_s in arrivals)
    numbers = np.array([number for _, number in ordered], dtype=np.int64)
    newer = numbers == np.maximum.accumulate(numbers) if len(numbers) else []
    at_s = np.array([at_s for at_s, _ in ordered])[newer]
    taken_s = np.minimum.reduce([_first_from(at_s, rate_hz) for rate_hz in rates_hz])
    alarm_s = _first_from(taken_s + limit_s + 1.0 / SECOND, rates_hz[0])
    beyond_s: Floats = taken_s[1:] - alarm_s[:-1]
    return beyond_s[beyond_s > _ROUNDING]


def _first_from(at_s: Floats, rate_hz: float) -> Floats:
    """Return the first instants (s) of a schedule of `rate_hz` at or after given ones."""
    result: Floats = np.ceil(at_s * rate_hz - _ROUNDING / 1000.0) / rate_hz
    return result


def all_lost_per_h(links: Sequence[Alarms | None]) -> float | None:
    """Return the rate per hour at which a follower loses all its sources, for independent links.

    One source is lost while the other already is: the rate of its alarms times that share of time.
    """
    known = [one for one in links if one is not None]
    if len(known) < len(links):
        return None
    if len(known) == 1:
        return known[0].per_h
    one, other = known
    return HOUR_S * (one.per_s * other.lost_ratio + other.per_s * one.lost_ratio)


def _is_even(source: VehicleSetup) -> bool:
    gnss = source.gnss
    always = gnss.fix != "none" and not gnss.fix_states and not gnss.outages
    return always and source.even_rate_hz is not None
