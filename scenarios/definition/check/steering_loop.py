"""Whether cars steer as the theory of their law demands: sampled loop, slip, certificate."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.scenario_tables import CONTROLLERS
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.theory.sampled_loop import SampledLoop, lowest_stable_rate, sampled_stability

PAPER_LAWS = {CONTROLLERS["feedforward_feedback"], CONTROLLERS["slip_compensated"]}
"""On a straight they are one law; of others nothing is known."""

SLOWEST = 1.0
"""Speed (m/s) below which the loop is not looked at."""

SPEEDS = 4
"""At so many speeds from the least to the greatest planned one."""
PAPER_LAW = CONTROLLERS["feedforward_feedback"]

LEFT_BY_SLIP = 0.01
"""So far (m) beside the path a car may settle in bends before that is said."""
STEP = 0.1
"""Time step (s) at which the lead's planned speed is sampled."""


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
        imu_hz=None if setup.has_exact_state else setup.imu_rate_hz,
        gnss_hz=setup.gnss.rate,
        gnss=replace(setup.gnss.noise, position=setup.gnss.initial_deviation),
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


def slip_warnings(scenario: Scenario, planned: Sequence[tuple[float, float]]) -> Iterator[str]:
    """Say how far beside the path followers settle, at `planned` speeds (m/s), curvatures (1/m).

    The heading error of a car that corners settles at its slip angle, which by eq. (7) a lateral
    error balances.
    """
    offsets = {}
    for name in scenario.vehicle_names[1:]:
        setup = scenario.vehicle(name)
        if not setup.steering.estimate_slip or setup.controller != PAPER_LAW:
            continue
        gains, car = setup.gains, setup.parameters
        slip = max(abs(bend * car.steady_slip_per_curvature(speed)) for speed, bend in planned)
        offsets[name] = slip * gains.heading / gains.lateral
    if offsets and (most := max(offsets.values())) >= LEFT_BY_SLIP:
        yield (
            f"{', '.join(offsets)}: estimate_slip learns the load, but in bends the paper's law "
            f"settles {100.0 * most:.1f} cm beside the path, for cars do not point along it there: "
            'control.controller = "slip_compensated" does not'
        )


def certificate_warnings(scenario: Scenario) -> Iterator[str]:
    """Give a line for each vehicle whose certificate the lead's planned speed leaves.

    The certificate bounds the change of speed up to which the closed steering loop is certainly
    stable (paper, Proposition 1, made a number: see `vehicles.theory.varying_speed`). It covers the
    linear loop with the paper's law; followers that keep a gap may accelerate a little more than
    the lead.
    """
    said: dict[tuple[VehicleParameters, Gains], str] = {}
    for name in scenario.vehicle_names:
        setup = scenario.vehicle(name)
        said.setdefault((setup.parameters, setup.gains), name)
    for (parameters, gains), name in said.items():
        yield from _leaving(scenario, parameters, gains, name)


def _leaving(
    scenario: Scenario, parameters: VehicleParameters, gains: Gains, name: str
) -> Iterator[str]:
    from vehicles.theory.varying_speed import (  # noqa: PLC0415 - scipy is an extra
        FASTEST,
        SLOWEST,
        certified_acceleration,
    )

    slow = fast = False
    worst = (1.0, 0.0, 0.0, 0.0)  # share of the bound, time, acceleration, bound
    for k in range(int(scenario.duration_s / STEP)):
        at = k * STEP
        speed, acceleration = scenario.route.profile.at(at)
        slow, fast = slow or speed < SLOWEST, fast or speed > FASTEST
        if acceleration == 0.0 or not SLOWEST <= speed <= FASTEST:
            continue
        bounds = certified_acceleration(parameters, gains, speed)
        bound = bounds[acceleration > 0.0]
        share = abs(acceleration) / bound if bound else float("inf")
        if share > worst[0]:
            worst = (share, at, acceleration, bound)
    if slow or fast:
        reached = " and ".join(
            text
            for text, found in (
                (f"below {SLOWEST:g}", slow),
                (f"above {FASTEST:g}", fast),
            )
            if found
        )
        yield f"{name}: speeds {reached} m/s are not covered by the varying-speed certificate"
    if worst[0] > 1.0:
        _, at, acceleration, bound = worst
        yield (
            f"{name}: {acceleration:.1f} m/s² at {at:.1f} s leaves the varying-speed certificate "
            f"of its gains, which holds up to {bound:.1f} m/s² there"
        )
