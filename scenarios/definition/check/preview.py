"""Whether followers receive enough of the path ahead of them to steer along it, and after a cut."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from math import inf

from scenarios.definition.channel.build import expected_channel, usual_delay_ms, vehicles_between
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.change_tables import CutTable
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.car.sending_rules import EveryFix
from vehicles.driver.source import MIN_SAMPLES
from vehicles.preview.curve_fit import FitSettings
from vehicles.schedule import MILLISECOND

SLOWEST = 0.1
"""Lowest speed (m/s) at which the preview is checked."""


@dataclass(frozen=True, slots=True)
class _Sight:
    """Path that a follower knows from one source at one speed (m/s).

    The path is known `reach` (m) ahead when the newest pose is oldest. The preview takes `preview`
    (m) of it, which hold `samples` poses. The fit keeps `behind` (m) behind the ego. `remedy` leads
    to more poses.
    """

    source: str
    speed: float
    reach: float
    preview: float
    samples: float
    behind: float
    remedy: str


def preview_warnings(scenario: Scenario, speeds: tuple[float, float]) -> Iterator[str]:
    """Warn of previews (paper, Section III-A) that are too short or hold too few poses.

    `speeds` (m/s) are the lowest and the highest planned. The path is known up to the newest pose
    of a source: its spacing less the distance driven during latency and one interval of poses.
    """
    found = dict[str, dict[str, _Sight]]()
    for name in scenario.vehicle_names[1:]:
        if name in scenario.tables.replayed:
            continue
        for speed in {max(speed, SLOWEST) for speed in speeds}:
            sight = _best_sight(scenario, scenario.vehicle(name), speed)
            if sight.samples < MIN_SAMPLES:
                found.setdefault("thin", {}).setdefault(name, sight)
            elif sight.reach < sight.behind:
                found.setdefault("short", {}).setdefault(name, sight)
    keeps_gap = scenario.tables.speed.followers == "gap"
    gap_key = "speed.gap.standstill_m" if keeps_gap else "convoy.gap_m"
    for kind, sights in sorted(found.items(), reverse=True):
        worst = min(sights.values(), key=lambda sight: sight.reach)
        text = f"{', '.join(sights)}: at {worst.speed:g} m/s the "
        if kind == "thin":
            yield (
                f"{text}preview ({worst.preview:.1f} m of known path) holds {worst.samples:.1f} "
                f"poses of {worst.source} ({MIN_SAMPLES} needed): corners will be cut. "
                f"{worst.remedy} or raise {gap_key}."
            )
        else:
            yield (
                f"{text}path of {worst.source} is known {worst.reach:.1f} m ahead "
                f"({worst.behind:.1f} m needed): curves are detected late and errors may grow. "
                f"Raise {gap_key} or lower links.latency_ms."
            )


def _best_sight(scenario: Scenario, setup: VehicleSetup, speed: float) -> _Sight:
    """Return the source known furthest ahead for a composite trajectory; else the nearest one."""
    lateral = setup.flow.lateral
    names = lateral if setup.steering.fusion.use == "composite" else lateral[-1:]
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
    # An unknown loss, as in a tunnel, counts only where the link carries anything at all.
    lost = link.loss_ratio if loss is None else loss
    rate = min(sent, link.rate_hz or sent) * (1.0 - lost)
    interval = 1.0 / rate if rate else inf
    delay = (sender.gnss.latency / MILLISECOND + usual_delay_ms(link)) / 1000.0
    reach = distance - speed * (delay + interval)
    if delay > interval:
        remedy = "Lower links.latency_ms"
    elif lost > 0.6:
        remedy = "Reduce the loss"
    else:
        is_every_fix = isinstance(sender.sending, EveryFix)
        remedy = "Raise gnss.rate_hz" if is_every_fix else "Raise the rate of sending"
    preview = min(settings.ahead(speed), max(reach, 0.0))
    return _Sight(
        source=source,
        speed=speed,
        reach=reach,
        preview=preview,
        samples=preview * rate / speed,
        behind=settings.behind(speed),
        remedy=remedy,
    )


def spacing_to(scenario: Scenario, place: int, source: str, speed: float) -> float:
    """Distance (m) between the centres of a vehicle and a source, at the start or as kept."""
    first, place = sorted((scenario.vehicle_names.index(source), place))
    if scenario.tables.speed.followers == "gap":
        between = range(first + 1, place + 1)
        return sum(scenario.spacing_policy(one).desired(speed) for one in between)
    return sum(scenario.route.spacings[first + 1 : place + 1])


def history_warnings(scenario: Scenario, fastest: float) -> Iterator[str]:
    """Warn if the lead, at up to `fastest` (m/s), drives further in a cut than histories reach."""
    reach = min(scenario.vehicle(name).sending.path_history for name in scenario.vehicle_names)
    cuts = [change for change in scenario.tables.change if isinstance(change, CutTable)]
    longest = max([cut.for_s or 0.0 for cut in cuts if cut.sender == "*"], default=0.0)
    if 0.0 < reach < fastest * longest and not scenario.tables.speed.lead_waits:
        yield (
            f"in a cut of {longest:g} s the lead drives up to {fastest * longest:.0f} m, path "
            f"histories reach {reach:g} m: followers will stand before the hole. Set "
            "speed.lead_waits, or raise sending.path_history_m."
        )
