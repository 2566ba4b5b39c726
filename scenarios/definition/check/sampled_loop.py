"""Whether a car knows itself and decides often enough for its speed."""

from collections.abc import Iterator
from dataclasses import replace

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.tables import CONTROLLERS
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.theory.sampled_loop import SampledLoop, lowest_stable_rate, sampled_stability

PAPER_LAWS = {CONTROLLERS["feedforward_feedback"], CONTROLLERS["slip_compensated"]}
"""On a straight they are one law; of others nothing is known."""

SLOWEST = 1.0
"""Speed (m/s) below which the loop is not looked at."""

SPEEDS = 4
"""At so many speeds from the least to the greatest planned one."""


def sampled_loop_warnings(scenario: Scenario, speeds: tuple[float, float]) -> Iterator[str]:
    """Give a line for each kind of car whose steering loop, as it is run, is not stable.

    `speeds` (m/s) are the least and the greatest that are planned. See
    `vehicles.theory.sampled_loop`: errors grow on a straight at constant speed, whatever is heard.
    """
    said: dict[SampledLoop, list[str]] = {}
    for name in scenario.vehicle_names:
        setup = scenario.vehicle(name)
        if setup.controller in PAPER_LAWS:
            said.setdefault(_loop(scenario, setup), []).append(name)
    least, most = (max(speed, SLOWEST) for speed in speeds)
    for loop, names in said.items():
        for k in range(SPEEDS if most > least else 1):
            speed = most - k * (most - least) / (SPEEDS - 1)
            found = sampled_stability(loop, speed)
            if not found.stable:
                yield f"{', '.join(names)}: {_unstable(loop, speed, -found.decay)}"
                break


def _loop(scenario: Scenario, setup: VehicleSetup) -> SampledLoop:
    return SampledLoop(
        parameters=setup.parameters,
        assumed=setup.assumed_parameters,
        gains=setup.gains,
        control_hz=scenario.control_rate_hz,
        imu_hz=None if setup.knows_itself else setup.imu_rate_hz,
        gnss_hz=setup.gnss.rate,
        gnss=replace(setup.gnss.noise, position=setup.gnss.own_deviation),
        imu=setup.imu.noise,
    )


def _unstable(loop: SampledLoop, speed: float, growth: float) -> str:
    if loop.imu_hz is None:
        rates = f"control at {loop.control_hz:g} Hz"
    else:
        rates = f"control at {loop.control_hz:g} Hz, own motion known at {loop.imu_hz:g} Hz"
    return (
        f"with {rates} and these gains steering is unstable at {speed:.1f} m/s, errors grow by "
        f"{growth:.2g} 1/s; {_remedy(loop, speed)}"
    )


def _remedy(loop: SampledLoop, speed: float) -> str:
    """What makes it stable: a faster sensor, or faster control."""
    control = round(loop.control_hz)
    if loop.imu_hz is not None and loop.imu_hz < control:
        lowest = lowest_stable_rate(lambda rate: replace(loop, imu_hz=rate), speed, control)
        if lowest is not None:
            return f"it is stable from imu.rate_hz = {lowest} on"
    if sampled_stability(replace(loop, imu_hz=100.0, control_hz=100.0), speed).stable:
        return "raise control.rate_hz, which is imu.rate_hz too unless that is given"
    return "other gains are needed"
