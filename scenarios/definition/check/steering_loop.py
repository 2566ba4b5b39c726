"""Theory of the steering laws: sampled loop, slip, and largest alpha."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from scenarios.definition.scenario import Scenario
from scenarios.definition.vehicle_setup import VehicleSetup
from vehicles.geometry.sampled_path import FloatArray
from vehicles.theory.gain_sets import abscissa
from vehicles.theory.linear_model import propagation
from vehicles.theory.sampled_loop import SampledLoop, lowest_stable_rate, sampled_decay
from vehicles.theory.string_stability import largest_weight, peak

PAPER_LAWS = {"feedforward_feedback", "slip_compensated"}
"""On a straight they are one law; other laws are not checked."""

SLOWEST = 1.0
"""Lowest speed (m/s) at which the loop is checked."""

SPEEDS = 4
"""Number of speeds checked between the lowest and the highest planned."""
FUSIONS = {"composite", "blend"}
"""Fusions whose trajectories weigh both sources by alpha_ratio."""
PAPER_LAW = "feedforward_feedback"

LEFT_BY_SLIP = 0.01
"""Lateral offset (m) in bends above which a warning is due."""


def sampled_loop_warnings(scenario: Scenario, speeds: tuple[float, float]) -> Iterator[str]:
    """Warn of each kind of car whose sampled steering loop is unstable.

    `speeds` (m/s) are the lowest and the highest planned. In an unstable loop errors grow on a
    straight at constant speed, whatever is received; see `vehicles.theory.sampled_loop`.
    """
    names_by_loop: dict[SampledLoop, list[str]] = {}
    for name in scenario.vehicle_names:
        setup = scenario.vehicle(name)
        if setup.steering.controller.use in PAPER_LAWS:
            names_by_loop.setdefault(_loop(scenario, setup), []).append(name)
    least, most = (max(speed, SLOWEST) for speed in speeds)
    for loop, names in names_by_loop.items():
        for k in range(SPEEDS if most > least else 1):
            speed = most - k * (most - least) / (SPEEDS - 1)
            decay = sampled_decay(loop, speed)
            if decay <= 0.0:
                yield f"{', '.join(names)}: {_unstable(loop, speed, -decay)}"
                break


def _loop(scenario: Scenario, setup: VehicleSetup) -> SampledLoop:
    return SampledLoop(
        parameters=setup.parameters,
        assumed=setup.assumed_parameters,
        gains=setup.gains,
        control_hz=scenario.control_rate_hz,
        imu_hz=None if setup.has_exact_state else setup.imu_rate_hz,
        gnss_hz=setup.gnss.rate,
        gnss=replace(setup.gnss, position_noise=setup.gnss.initial_deviation),
        imu=setup.imu,
    )


def _unstable(loop: SampledLoop, speed: float, growth: float) -> str:
    if loop.imu_hz is None:
        rates = f"control at {loop.control_hz:g} Hz"
    else:
        rates = f"control at {loop.control_hz:g} Hz, own motion known at {loop.imu_hz:g} Hz"
    return (
        f"with {rates} and these gains, steering is unstable at {speed:.1f} m/s: errors grow by "
        f"{growth:.2g} 1/s. {_remedy(loop, speed)}"
    )


def _remedy(loop: SampledLoop, speed: float) -> str:
    """Return what makes the loop stable: a faster sensor, or faster control."""
    control = round(loop.control_hz)
    if loop.imu_hz is not None and loop.imu_hz < control:
        lowest = lowest_stable_rate(lambda rate: replace(loop, imu_hz=rate), speed, control)
        if lowest is not None:
            return f"Raise imu.rate_hz to {lowest} or more."
    if sampled_decay(replace(loop, imu_hz=100.0, control_hz=100.0), speed) > 0.0:
        return "Raise control.rate_hz, which also sets imu.rate_hz unless that is given."
    return "Set other control.gains."


def slip_warnings(scenario: Scenario, speeds: FloatArray, curvatures: FloatArray) -> Iterator[str]:
    """Warn if followers settle beside the path in bends.

    `speeds` (m/s) and `curvatures` (1/m) are those of the lead's plan. In a bend the heading error
    settles at the slip angle, which a lateral error balances by eq. (7).
    """
    offsets = {}
    for name in scenario.vehicle_names[1:]:
        setup = scenario.vehicle(name)
        if not setup.steering.estimate_slip or setup.steering.controller.use != PAPER_LAW:
            continue
        gains, car = setup.gains, setup.parameters
        if not gains.lateral:  # a law without it settles nowhere
            continue
        still = car.steady_slip_per_curvature(0.0)
        change = car.steady_slip_per_curvature(1.0) - still  # per squared speed
        slip = float(np.max(np.abs(curvatures * (still + change * speeds * speeds))))
        offsets[name] = slip * gains.heading / gains.lateral
    if offsets and (most := max(offsets.values())) >= LEFT_BY_SLIP:
        yield (
            f"{', '.join(offsets)}: with estimate_slip the paper's law settles "
            f"{100.0 * most:.1f} cm beside the path in bends, where cars slip. Set "
            'control.controller = "slip_compensated".'
        )


def largest_alphas(scenario: Scenario, speeds: tuple[float, float]) -> dict[str, dict[str, float]]:
    """Return alpha* = 1 / ||G||_inf of each follower with a lead and another predecessor.

    Below alpha* (paper, Section IV-B; `vehicles.theory.string_stability.largest_weight`) an error
    that a car adds is not amplified behind it, at any frequency. The value is the lower one of
    those at `speeds` (m/s), the lowest and the highest planned. Unstable loops have none.
    """
    found: dict[str, dict[str, float]] = {}
    for name in scenario.vehicle_names[2:]:
        setup = scenario.vehicle(name)
        steering = setup.steering
        if steering.controller.use not in PAPER_LAWS or steering.fusion.use not in FUSIONS:
            continue
        if setup.flow.lateral != (setup.lead, setup.predecessor):
            continue
        rows = []
        for speed in {max(speed, SLOWEST) for speed in speeds}:
            car = setup.parameters, setup.gains, speed
            if float(abscissa(*car[:2], [speed])[0]) < 0.0:
                transfer = propagation(*car)
                rows.append((largest_weight(transfer), speed, peak(transfer).frequency))
        if rows:
            keys = ("largest_alpha_ratio", "speed_mps", "frequency_radps")
            found[name] = dict(zip(keys, min(rows), strict=True))
    return found
