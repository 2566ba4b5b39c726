"""Convoys that are longer than a lap of their closed path, or nearly so."""

from collections.abc import Iterator

from scenarios.definition.road.spacing import spacing_policy
from scenarios.definition.scenario import Scenario
from vehicles.car.parameters import least_spacing


def longer_than_lap(scenario: Scenario) -> Iterator[str]:
    """Report a convoy that does not fit on a lap even if it stands."""
    lap, vehicles = _driven_lap(scenario), len(scenario.vehicle_names)
    if not lap:
        return
    keeps_gap = bool(scenario.tables.speed.lead_keeps_gap)
    speed = 0.0 if keeps_gap else max(scenario.route.profile.speeds)
    length = _length(scenario, speed, whole=keeps_gap)
    if length < lap:
        return
    end = "stops permanently behind" if keeps_gap else "runs into"
    cars = vehicles if keeps_gap else vehicles - 1
    most = max(int(lap * cars / length), 2)
    several = ", or path.laps = 1" if scenario.tables.path.laps > 1 else ""
    yield (
        f"the convoy is {length:.0f} m long and a lap {lap:.0f} m: its lead {end} its last "
        f"vehicle; set convoy.vehicles = {most} or less, smaller gaps{several}"
    )


def lap_warnings(scenario: Scenario) -> Iterator[str]:
    """Warn if the lead must drive slower than planned behind its last vehicle."""
    lap, names = _driven_lap(scenario), scenario.vehicle_names
    if not lap or not scenario.tables.speed.lead_keeps_gap:
        return
    fastest = max(scenario.route.profile.speeds)
    length, standing = (_length(scenario, speed, whole=True) for speed in (fastest, 0.0))
    if not standing < lap < length:
        return
    slower = fastest * (lap - standing) / (length - standing)
    yield (
        f"at {fastest:.1f} m/s the convoy with its gaps is {length:.0f} m long and a lap "
        f"{lap:.0f} m: the lead keeps its distance from {names[-1]} ahead of it and drives at most "
        f"{slower:.1f} m/s on average. Lower convoy.vehicles or the gaps."
    )


def _driven_lap(scenario: Scenario) -> float:
    """Length (m) of a lap of a closed path if the lead drives one; else 0."""
    route = scenario.route
    several = len(scenario.vehicle_names) > 1
    driven = route.profile.distance(scenario.duration_s)
    return route.lap if several and driven >= route.lap else 0.0


def _length(scenario: Scenario, speed: float, *, whole: bool) -> float:
    """Length (m) of the convoy at `speed` (m/s), between centres of mass; `whole`, of all gaps.

    All gaps include that of the lead to the last vehicle ahead of it.
    """
    tables, names = scenario.tables, scenario.vehicle_names
    if tables.speed.followers == "gap":
        places = range(1, len(names))
        length = sum(scenario.spacing_policy(place).desired(speed) for place in places)
    else:
        length = sum(scenario.route.spacings)
    if not whole:
        return length
    cars = [scenario.vehicle(name).parameters for name in (names[-1], names[0])]
    return length + spacing_policy(tables, least_spacing(*cars)).desired(speed)
