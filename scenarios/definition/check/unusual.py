"""Settings that hardly anybody means."""

import os
from collections.abc import Iterator

from scenarios.definition.road.route import spacing_policy
from scenarios.definition.scenario import Scenario
from vehicles.car.parameters import least_spacing
from vehicles.driver.convoy import shortest_loop

# ---- Convoys that are longer than a lap or another loop of their path


LAP_TOLERANCE = 1.0
"""A loop that is shorter than the lap by less than this (m) is the lap."""


def longer_than_lap(scenario: Scenario) -> Iterator[str]:
    """Report a convoy that does not fit on a lap, or on another loop at full speed.

    On a lap the lead may keep its distance; then the convoy must fit if it stands.
    """
    route, names = scenario.route, scenario.vehicle_names
    if len(names) < 2:
        return
    driven, length = route.profile.distance(scenario.duration_s), _length(scenario)
    lead, last = (scenario.vehicle(name).parameters for name in (names[0], names[-1]))
    end = route.start + (min(driven, 2.0 * route.lap) if route.lap else driven)
    loop, what = shortest_loop(route.path, lead, last, end, length), "loop"
    if loop >= (route.lap - LAP_TOLERANCE if route.lap else length):
        if not route.lap or driven < route.lap:
            return
        loop, what = route.lap, "lap"
    meets, gaps = (
        "runs into" if what == "lap" else "or another vehicle can run into",
        len(names) - 1,
    )
    if what == "lap" and scenario.tables.speed.lead_keeps_gap:
        meets, gaps = "stops permanently behind", len(names)
        own = spacing_policy(scenario.tables, least_spacing(last, lead))
        length = _length(scenario, 0.0) + own.desired(0.0)
    if length >= loop:
        several = ", or path.laps = 1" if scenario.tables.path.laps > 1 else ""
        yield (
            f"the convoy is {length:.0f} m long and a {what} {loop:.0f} m: its lead {meets} its "
            f"last vehicle. Set convoy.vehicles = {max(int(loop * gaps / length), 2)} or less, "
            f"smaller gaps{several}."
        )


def _length(scenario: Scenario, speed: float | None = None) -> float:
    """Length (m) of the convoy at `speed` (m/s) or full speed, between centres of mass."""
    if scenario.tables.speed.followers != "gap":
        return sum(scenario.route.spacings)
    speed = max(scenario.route.profile.speeds) if speed is None else speed
    places = range(1, len(scenario.vehicle_names))
    return sum(scenario.spacing_policy(place).desired(speed) for place in places)


# ---- Warnings


VEHICLES_PER_CORE = 10
"""Number of vehicles that a core carries in real time (measured)."""

LATENCY_MS_MIN = 1.0
"""Messages between two processes take about this long."""


def unusual_settings(scenario: Scenario, *, wall_clock: bool) -> Iterator[str]:
    """Warn of settings of a run, in real time or not, that are hardly ever meant."""
    if len(scenario.vehicle_names) == 1:
        yield "convoy.vehicles = 1 is a lead without followers: nothing is followed. Set 2 or more."
    yield from longer_than_lap(scenario)
    if wall_clock:
        yield from _too_many_vehicles(scenario)
    yield from _small_latency(scenario, wall_clock=wall_clock)


def _too_many_vehicles(scenario: Scenario) -> Iterator[str]:
    count, cores = len(scenario.vehicle_names), _cores()
    if count > VEHICLES_PER_CORE * cores:
        yield (
            f"{count} vehicles in real time on {cores} {'core' if cores == 1 else 'cores'}, which "
            f"carry up to {VEHICLES_PER_CORE * cores}: ticks will be late. Use --clock virtual, "
            f"more machines (convoy vehicle), or convoy.vehicles = {VEHICLES_PER_CORE * cores}."
        )


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _small_latency(scenario: Scenario, *, wall_clock: bool) -> Iterator[str]:
    """Warn of the link with the smallest latency if that is less than any radio has."""
    links = {
        pair: table.latency_ms
        for pair, table in scenario.links.items()
        if not (table.loss and table.loss.replaces_others)
    }
    pair = min(links, key=lambda pair: links[pair], default=None)
    if pair is None or (latency := links[pair]) >= LATENCY_MS_MIN or not (latency or wall_clock):
        return
    hint = f" (did you mean {1000.0 * latency:g}?)" if latency else ""
    setting = f"latency_ms = {latency:g} on link {pair[0]} → {pair[1]}{hint}"
    if wall_clock:
        yield (
            f"{setting}: messages between processes take about 1 ms and will count as late. Set 5 "
            "or more, or use --clock virtual."
        )
    else:
        yield f"{setting} is less than any radio has"
