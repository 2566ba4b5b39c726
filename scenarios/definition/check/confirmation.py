"""Settings that hardly anybody means, which a command runs only with `--yes`."""

import os
from collections.abc import Iterator

from scenarios.definition.check.lap import longer_than_lap
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario

VEHICLES_PER_CORE = 20
"""A core carries ten vehicles in real time, and twenty with compiled modules (measured)."""

LATENCY_MS_MIN = 1.0
"""Messages between two processes take about this long."""


def confirmation_lines(scenario: Scenario, *, wall_clock: bool) -> tuple[str, ...]:
    """Return a line for each setting of a run that needs `--yes`."""
    lines = [*_too_few_vehicles(scenario), *longer_than_lap(scenario)]
    if wall_clock:
        lines += [*_too_many_vehicles(scenario), *_too_little_latency(scenario)]
    return tuple(lines)


def confirmed_lines(scenario: Scenario, *, wall_clock: bool, confirmed: bool) -> tuple[str, ...]:
    """Return warnings about unusual settings; raises ScenarioError if one is not `confirmed`."""
    lines = confirmation_lines(scenario, wall_clock=wall_clock)
    if lines and not confirmed:
        raise ScenarioError(f"{scenario.name}: {line} (--yes runs it anyway)" for line in lines)
    return lines if wall_clock else (*lines, *_implausible_latency(scenario))


def _too_few_vehicles(scenario: Scenario) -> Iterator[str]:
    if len(scenario.vehicle_names) == 1:
        yield "convoy.vehicles = 1 is a lead without followers: nothing is followed, set 2 or more"


def _too_many_vehicles(scenario: Scenario) -> Iterator[str]:
    count, cores = len(scenario.vehicle_names), _cores()
    if count > VEHICLES_PER_CORE * cores:
        yield (
            f"{count} vehicles in real time on {cores} {'core' if cores == 1 else 'cores'}, which "
            f"carry up to {VEHICLES_PER_CORE * cores}: ticks will be late; use --clock virtual, "
            f"more machines (convoy vehicle), or convoy.vehicles = {VEHICLES_PER_CORE * cores}"
        )


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _too_little_latency(scenario: Scenario) -> Iterator[str]:
    for name, latency, hint in _small_latency(scenario):
        yield (
            f"latency_ms = {latency:g} on link {name}{hint}: messages between processes take about "
            "1 ms and will count as late; set 5 or more, or use --clock virtual"
        )


def _implausible_latency(scenario: Scenario) -> Iterator[str]:
    for name, latency, hint in _small_latency(scenario):
        if latency:
            yield f"latency_ms = {latency:g} on link {name} is less than any radio has{hint}"


def _small_latency(scenario: Scenario) -> Iterator[tuple[str, float, str]]:
    """Yield the link with the smallest latency (ms) if that is too small, with a hint."""
    links = {
        pair: table.latency_ms
        for pair, table in scenario.links.items()
        if not (table.loss and table.loss.replaces_others)
    }
    pair = min(links, key=lambda pair: links[pair], default=None)
    if pair is not None and (latency := links[pair]) < LATENCY_MS_MIN:
        hint = f" (did you mean {1000.0 * latency:g}?)" if latency else ""
        yield f"{pair[0]} → {pair[1]}", latency, hint
