"""Whether followers receive enough of the path ahead of them to steer along it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from scenarios.definition.channel.build import usual_delay_ms, vehicles_between
from scenarios.definition.channel.expected import expected_channel
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.car.sending.every_fix import EveryFix
from vehicles.driver.degradation.source import MIN_SAMPLES
from vehicles.preview.curve_fit import FitSettings
from vehicles.schedule import MILLISECOND

SLOWEST = 0.1
"""Speed (m/s) below which the preview is not checked."""


@dataclass(frozen=True, slots=True)
class _Sight:
    """What a follower receives of a source at one speed (m/s).

    The path is known `reach` (m) ahead at the greatest age of the newest pose; the preview takes
    `preview` (m) of it, with so many `samples`, `spacing` (m) apart. The fit keeps `behind` (m)
    behind the ego. `remedy` is the key by which more poses come.
    """

    source: str
    speed: float
    reach: float
    preview: float
    samples: float
    behind: float
    spacing: float
    remedy: str


def preview_warnings(scenario: Scenario, speeds: tuple[float, float]) -> Iterator[str]:
    """Give a line for each kind of preview (paper, Section III-A) that is too short or thin.

    `speeds` (m/s) are the least and the greatest that are planned. The path is known up to the last
    pose received of a source: its spacing less the distance driven during latency and the time
    between two poses. Where that is less than the fit keeps behind the ego, curves are recognised
    late, and errors may grow; where fewer samples lie ahead than a fit takes, it joins rarer ones.
    """
    thin: dict[str, _Sight] = {}
    short: dict[str, _Sight] = {}
    for name in scenario.vehicle_names[1:]:
        if name in scenario.replays:
            continue
        for speed in {max(speed, SLOWEST) for speed in speeds}:
            seen = _seen(scenario, scenario.vehicle(name), speed)
            if seen.samples < MIN_SAMPLES:
                thin.setdefault(name, seen)
            elif seen.reach < seen.behind:
                short.setdefault(name, seen)
    keeps_gap = scenario.tables.speed.followers == "gap"
    gap_key = "speed.gap.standstill_m" if keeps_gap else "convoy.gap_m"
    for names, sight in _alike(thin):
        yield (
            f"{names}: at {sight.speed:g} m/s {sight.samples:.1f} poses of {sight.source} lie in "
            f"the preview, {sight.preview:.1f} m of which are known, and a trajectory takes "
            f"{MIN_SAMPLES}: it joins poses {sight.spacing:.3g} m apart from further away, cuts "
            f"the curves between them and is extrapolated; raise {sight.remedy} or {gap_key}"
        )
    for names, sight in _alike(short):
        yield (
            f"{names}: at {sight.speed:g} m/s the path of {sight.source} is known "
            f"{sight.reach:.1f} m ahead, less than the {sight.behind:.1f} m behind that the fit "
            f"keeps: curves are recognised late, and errors may grow; raise {gap_key} or lower the "
            "latency"
        )


def _alike(found: dict[str, _Sight]) -> Iterator[tuple[str, _Sight]]:
    """One line for all followers that are short of preview: their names, and the worst case."""
    if found:
        yield ", ".join(found), min(found.values(), key=lambda sight: sight.reach)


def _seen(scenario: Scenario, setup: VehicleSetup, speed: float) -> _Sight:
    """The source known furthest ahead, where they make one trajectory; else the predecessor."""
    names = setup.senders if setup.steering.fusion == "composite" else setup.senders[-1:]
    sights = [
        _sight(scenario, setup, name, scenario.links[name, setup.name], speed) for name in names
    ]
    return max(sights, key=lambda sight: sight.reach)


def _sight(
    scenario: Scenario, setup: VehicleSetup, source: str, link: LinkTable, speed: float
) -> _Sight:
    steering = setup.steering
    settings = FitSettings(preview_time=steering.preview_s, trajectory=steering.trajectory)
    sender = scenario.vehicle(source)
    sent = sender.usual_rate_hz(speed)
    distance = spacing_to(scenario, setup.place, source, speed)
    between = partial(vehicles_between, scenario.route, sender.place, setup.place)
    source_hz = sender.highest_rate_hz
    loss = expected_channel(link, source_hz, distance, between).loss_ratio
    # Without a number, as in a tunnel: what is known of it where it carries anything at all.
    rate = min(sent, link.rate_hz or sent) * (1.0 - (link.loss_ratio if loss is None else loss))
    late_ms = sender.gnss.latency / MILLISECOND + usual_delay_ms(link)
    age = late_ms / 1000.0 + (1.0 / rate if rate else float("inf"))
    reach = distance - speed * age
    preview = min(settings.ahead(speed), max(reach, 0.0))
    return _Sight(
        source=source,
        speed=speed,
        reach=reach,
        preview=preview,
        samples=preview * rate / speed,
        behind=settings.behind(speed),
        spacing=speed / rate if rate else float("inf"),
        remedy="gnss.rate_hz" if isinstance(sender.sending, EveryFix) else "the rate of sending",
    )


def spacing_to(scenario: Scenario, place: int, source: str, speed: float) -> float:
    """Distance (m) between the centres of a vehicle and a source, at the start or as kept."""
    first, place = sorted((scenario.vehicle_names.index(source), place))
    if scenario.tables.speed.followers == "gap":
        between = range(first + 1, place + 1)
        return sum(scenario.spacing_policy(one).desired(speed) for one in between)
    return sum(scenario.route.spacings[first + 1 : place + 1])
