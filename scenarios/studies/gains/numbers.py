"""The numbers of the gains report: a function per section, plain values, units in the keys."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vehicles.car.parameters import (
    Gains,
    Loading,
    VehicleParameters,
    loaded,
    loaded_with_moved_centre,
)
from vehicles.theory.constant_speed import guaranteed_decay, is_stable_over
from vehicles.theory.gain_margins import Ball, common_ball, gain_interval, stability_ball
from vehicles.theory.gain_sets import (
    abscissa,
    gain_box,
    gain_extremes,
    is_stabilising,
    non_convex_pair,
    singular_frequency,
    stabilises_all,
)
from vehicles.theory.linear_model import characteristic_polynomial, steady_cornering
from vehicles.theory.propagation import (
    SteeringModel,
    low_frequency_growth,
    propagation,
    trace_propagation,
)
from vehicles.theory.simulated_chain import SIMULATED_FREQUENCIES, simulated_propagation
from vehicles.theory.string_stability import (
    LANE_CHANGE_BAND,
    amplified_band,
    largest_weight,
    maximum_gain,
    peak,
)
from vehicles.theory.varying_speed import (
    FASTEST,
    SLOWEST,
    UNIT_WEIGHTS,
    bounds_from,
    certify,
    lyapunov_change,
)

TOLERANCE = 1e-9
"""Distance from the boundary (spectral abscissa over the steering frequency) off which membership
by Routh-Hurwitz must agree with the roots."""

STEERING_MODELS: tuple[SteeringModel, ...] = ("instantaneous", "second order")

Report = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Subject:
    """What a report is about; speeds (m/s) rising, the last being the one shown where one is."""

    parameters: VehicleParameters
    gains: Gains
    speeds: Sequence[float]
    loadings: Sequence[Loading]

    @property
    def reference(self) -> float:
        """Speed (m/s) of what is shown at one speed."""
        return self.speeds[-1]

    @property
    def cars(self) -> list[VehicleParameters]:
        """The car with each loading."""
        return [loaded(self.parameters, loading) for loading in self.loadings]


def named(gains: Gains) -> Report:
    """Give the gains by the names and units of the scenario file."""
    return {
        "lateral_rad_per_m": gains.lateral,
        "heading_rad_per_rad": gains.heading,
        "yaw_rate_s": gains.yaw_rate,
    }


def _ball(ball: Ball, radius_key: str = "radius_in_gain_units") -> Report:
    return {
        radius_key: ball.radius,
        "nearest_unstable": named(ball.nearest),
        "root_there_radps": ball.frequency,
        "limiting_speed_mps": ball.speed,
    }


def stabilising_set(subject: Subject) -> Report:
    """Say whether the gains are inside the sets, how large those are, and how deep inside."""
    parameters, gains, speeds = subject.parameters, subject.gains, subject.speeds
    cars, reference = subject.cars, subject.reference
    relative = (gains.lateral, gains.heading, gains.yaw_rate)
    pair = non_convex_pair([parameters], [reference])
    report: Report = {
        "inside_at_all_speeds": bool(stabilises_all([parameters], speeds, np.array(gains))),
        "inside_at_all_speeds_and_loadings": bool(stabilises_all(cars, speeds, np.array(gains))),
        "box_at_reference_speed": _box([parameters], [reference]),
        "box_over_speeds": _box([parameters], speeds),
        "box_over_speeds_and_loadings": _box(cars, speeds),
        "ball_at_reference_speed": _ball(stability_ball(parameters, reference, gains)),
        "ball_over_speeds_and_loadings": _ball(common_ball(cars, speeds, gains)),
        "not_convex_between": None if pair is None else [named(end) for end in pair],
    }
    if all(relative):
        at_reference = stability_ball(parameters, reference, gains, relative)
        over_all = common_ball(cars, speeds, gains, relative)
        report["relative_ball_at_reference_speed"] = _ball(at_reference, "radius_ratio")
        report["relative_ball_over_speeds_and_loadings"] = _ball(over_all, "radius_ratio")
    return report


def _box(cars: Sequence[VehicleParameters], speeds: Sequence[float]) -> Report:
    """Least and greatest gains of the set; that it is bounded is what `gain_box` found out."""
    extremes = gain_extremes(cars, speeds)
    names = ("lateral_rad_per_m", "heading_rad_per_rad", "yaw_rate_s")
    return {
        name: (least[k], most[k])
        for k, (name, (least, most)) in enumerate(zip(names, extremes, strict=True))
    }


def verification(subject: Subject) -> Report:
    """Membership against the roots on random gains around the set, at every speed."""
    parameters = subject.parameters
    random = np.random.default_rng(0)
    points = disagreements = 0
    for speed in subject.speeds:
        low, high = np.array(gain_box([parameters], [speed])).T
        sample = random.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), (300, 3))
        claimed = is_stabilising(parameters, speed, sample)
        for row, inside in zip(sample.tolist(), claimed, strict=True):
            roots = np.roots(characteristic_polynomial(parameters, Gains(*row), speed))
            margin = float(roots.real.max()) / parameters.steering_frequency
            points += 1
            disagreements += abs(margin) > TOLERANCE and bool(inside) != (margin < 0.0)
    return {
        "random_points": points,
        "disagreements_with_roots": disagreements,
        "boundary_tolerance_ratio": TOLERANCE,
    }


def at_speed(subject: Subject, speed: float) -> Report:
    """Collect what holds at one constant speed (m/s), steady cornering on a 300 m bend included."""
    parameters, gains = subject.parameters, subject.gains
    axes = {
        "lateral_change_rad_per_m": (1.0, 0.0, 0.0),
        "heading_change_rad_per_rad": (0.0, 1.0, 0.0),
        "yaw_rate_change_s": (0.0, 0.0, 1.0),
    }
    lateral, heading = steady_cornering(parameters, gains, speed, 1.0 / 300.0)
    return {
        "speed_mps": speed,
        "abscissa_per_s": float(abscissa(parameters, gains, [speed])[0]),
        "ball_radius": stability_ball(parameters, speed, gains).radius,
        **{
            name: gain_interval(parameters, speed, gains, direction)
            for name, direction in axes.items()
        },
        "steady_lateral_error_at_300_m_radius_m": lateral,
        "steady_heading_error_at_300_m_radius_rad": heading,
    }


def at_loading(subject: Subject, loading: Loading) -> Report:
    """Collect the roots at the reference speed and what else a loading changes (V-B)."""
    parameters, gains, speeds = subject.parameters, subject.gains, subject.speeds
    car, speed = loaded(parameters, loading), subject.reference
    roots = np.sort_complex(np.roots(characteristic_polynomial(car, gains, speed)))
    moved = loaded_with_moved_centre(parameters, loading)
    bend = 1.0 / 300.0
    return {
        "front_passengers": loading.front_passengers,
        "rear_passengers": loading.rear_passengers,
        "mass_kg": car.mass,
        "yaw_inertia_kgm2": car.yaw_inertia,
        "singular_frequency_radps": singular_frequency(car),
        "roots_per_s": [[float(root.real), float(root.imag)] for root in roots],
        "abscissa_per_s": float(roots.real.max()),
        "stable_at_every_speed": is_stable_over(car, gains, speeds[0], speeds[-1]),
        "steady_lateral_error_at_300_m_radius_m": steady_cornering(car, gains, speed, bend)[0],
        "steady_lateral_error_unknown_load_m": steady_cornering(
            car, gains, speed, bend, known=parameters
        )[0],
        "with_moved_centre": {
            "front_axle_distance_m": moved.front_axle_distance,
            "steer_gradient_s2_rad_per_m": moved.steer_gradient,
            "abscissa_per_s": float(abscissa(moved, gains, [speed])[0]),
        },
    }


def varying_speed(subject: Subject) -> Report:
    """Tabulate the certified accelerations against speed, beside simpler certificates (IV-A)."""
    parameters, gains = subject.parameters, subject.gains
    certificate = certify(parameters, gains)
    rows = []
    for speed in np.linspace(SLOWEST, FASTEST, 35).tolist() if certificate.holds else []:
        tuned, plain = certificate.weights, UNIT_WEIGHTS
        cases = {
            "certified": certificate.bounds(speed),
            "tuned_q_only": bounds_from(lyapunov_change(parameters, gains, speed, tuned)[0]),
            "unit_q_only": bounds_from(lyapunov_change(parameters, gains, speed, plain)[0]),
            "unit_q_paper_model": bounds_from(
                lyapunov_change(parameters, gains, speed, plain, speed_term=False)[0]
            ),
        }
        row: Report = {"speed_mps": speed}
        for name, bounds in cases.items():
            row |= {f"{name}_{key}_mps2": value for key, value in asdict(bounds).items()}
        rows.append(row)
    return {
        "slowest_mps": SLOWEST,
        "fastest_mps": FASTEST,
        "stable_at_every_speed": certificate.holds,
        "decay_per_s": guaranteed_decay(parameters, gains, SLOWEST, FASTEST),
        "q_diagonal": certificate.weights,
        "table": rows,
    }


def at_frequencies(subject: Subject, speed: float) -> Report:
    """Collect the propagation at one speed (IV-B); at the reference speed a simulation as well."""
    parameters, gains = subject.parameters, subject.gains
    stable = float(abscissa(parameters, gains, [speed])[0]) < 0.0
    report: Report = {"speed_mps": speed, "stable": stable}
    if not stable:
        return report
    report["low_frequency_growth_s2"] = low_frequency_growth(parameters, gains, speed)
    for steering in STEERING_MODELS:
        transfer = propagation(parameters, gains, speed, steering)
        whole, slow = peak(transfer), peak(transfer, LANE_CHANGE_BAND)
        row: Report = {
            "norm_ratio": whole.magnitude,
            "peak_radps": whole.frequency,
            "norm_below_1_hz_ratio": slow.magnitude,
            "peak_below_1_hz_radps": slow.frequency,
            "amplified_radps": amplified_band(transfer),
            "maximum_gain_ratio": maximum_gain(transfer),
            "largest_alpha_ratio": largest_weight(transfer),
        }
        if speed == subject.reference:
            found = simulated_propagation(parameters, gains, speed, SIMULATED_FREQUENCIES, steering)
            errors = np.abs(found / transfer.at(SIMULATED_FREQUENCIES) - 1.0)
            row["simulated_radps"] = SIMULATED_FREQUENCIES.tolist()
            row["simulated_ratio"] = np.abs(found).tolist()
            row["simulation_error_ratio_max"] = float(errors.max())
        report[steering.replace(" ", "_")] = row
    slow = peak(trace_propagation(parameters, gains, speed), LANE_CHANGE_BAND)
    report["traces"] = {
        "norm_below_1_hz_ratio": slow.magnitude,
        "peak_below_1_hz_radps": slow.frequency,
    }
    return report
