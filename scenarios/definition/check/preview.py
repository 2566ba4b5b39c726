"""Whether the followers of a scenario hear enough of the path ahead of them to steer along it."""

from collections.abc import Iterator
from dataclasses import dataclass

from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup
from transport.links.link import LinkRule
from vehicles.driver.follower import LEAST_SAMPLES
from vehicles.preview.trajectory import FitSettings

SLOWEST = 0.1
"""Below this speed (m/s) nobody follows anybody."""


@dataclass(frozen=True, slots=True)
class _Sight:
    """What a follower hears of a source at one speed (m/s).

    The path is known `reach` (m) ahead when the newest pose that counts is as old as it gets;
    of it the preview takes `preview` (m), on which there are so many `samples`. The fit keeps
    `behind` (m) of it behind the ego.
    """

    source: str
    speed: float
    reach: float
    preview: float
    samples: float
    behind: float


def preview_warnings(scenario: Scenario, speeds: tuple[float, float]) -> Iterator[str]:
    """Say in a line each where a follower's preview (paper, Section III-A) is too short or thin.

    `speeds` (m/s) are the least and the greatest that are planned. What is known of the path ends
    where a source was last heard: a gap, or a gap less what latency, the time between two poses
    and the speed make of it. Where that is less than the fit keeps behind the ego, it sees bends
    late, and errors may grow; where fewer samples lie ahead than a fit takes, it extrapolates.
    """
    thin: dict[str, _Sight] = {}
    short: dict[str, _Sight] = {}
    for name in scenario.vehicle_names[1:]:
        for speed in {max(speed, SLOWEST) for speed in speeds}:
            seen = _seen(scenario, scenario.vehicle(name), speed)
            if seen.samples < LEAST_SAMPLES:
                thin.setdefault(name, seen)
            elif seen.reach < seen.behind:
                short.setdefault(name, seen)
    for names, sight in _alike(thin):
        yield (
            f"{names}: at {sight.speed:g} m/s {sight.samples:.1f} poses of {sight.source} lie in "
            f"the preview, {sight.preview:.1f} m of which are known, and a trajectory takes "
            f"{LEAST_SAMPLES}: it will be extrapolated"
        )
    for names, sight in _alike(short):
        yield (
            f"{names}: at {sight.speed:g} m/s the path of {sight.source} is known "
            f"{sight.reach:.1f} m ahead, less than the {sight.behind:.1f} m behind that the fit "
            "keeps: bends are seen late, and errors may grow; widen the gap or lower the latency"
        )


def _alike(found: dict[str, _Sight]) -> Iterator[tuple[str, _Sight]]:
    """Join the followers for which the worst is to be said, so that a convoy gets one line."""
    if found:
        yield ", ".join(found), min(found.values(), key=lambda sight: sight.reach)


def _seen(scenario: Scenario, setup: VehicleSetup, speed: float) -> _Sight:
    """What reaches furthest, where the sources are made one trajectory; else the predecessor."""
    links = scenario.links_into(setup.name)
    names = setup.hears if setup.steering.fusion == "composite" else setup.hears[-1:]
    sights = [_sight(scenario, setup, name, links[name], speed) for name in names]
    return max(sights, key=lambda sight: sight.reach)


def _sight(
    scenario: Scenario, setup: VehicleSetup, source: str, link: LinkRule, speed: float
) -> _Sight:
    settings = FitSettings(preview_time=setup.steering.preview_s)
    sent = scenario.vehicle(source).gnss.rate_hz
    rate = min(sent, link.rate_hz or sent) * (1.0 - link.loss_ratio)
    age = (link.latency_ms + link.jitter_ms) / 1000.0 + (1.0 / rate if rate else float("inf"))
    reach = _gap(scenario, setup.place, source, speed) - speed * age
    preview = min(settings.ahead(speed), max(reach, 0.0))
    return _Sight(source, speed, reach, preview, preview * rate / speed, settings.behind(speed))


def _gap(scenario: Scenario, place: int, source: str, speed: float) -> float:
    """Distance (m) to a source ahead: that of the start, or the one that is kept."""
    first = scenario.vehicle_names.index(source)
    if scenario.tables.speed.followers == "gap":
        return (place - first) * scenario.gap_policy.desired(speed)
    return sum(scenario.route.gaps[first + 1 : place + 1])
