"""`convoy paper gains`: analysis of one choice of steering gains, as JSON and plots."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from scenarios.studies.gains.subject import PICTURES, Subject
from scenarios.studies.job import refuse_existing
from vehicles.car.parameters import (
    Gains,
    Loading,
    VehicleParameters,
    all_loadings,
    loaded,
    loaded_with_moved_centre,
)
from vehicles.theory.gain_sets import (
    PAPER_SPEEDS,
    Ball,
    common_ball,
    gain_extremes,
    guaranteed_decay,
    is_stable_over,
    non_convex_pair,
    stabilises_all,
    stability_ball,
)
from vehicles.theory.linear_model import (
    SteeringModel,
    characteristic_polynomial,
    low_frequency_growth,
    propagation,
    steady_cornering,
    trace_propagation,
)
from vehicles.theory.sampled_loop import SampledLoop, lowest_stable_rate, sampled_decay
from vehicles.theory.string_stability import LANE_CHANGE_BAND, amplified_band, largest_weight, peak
from vehicles.theory.varying_speed import FASTEST, SLOWEST, certify

Table = dict[str, Any]
"""A part of gains.json: keys end with units."""

DEFAULT_SPEEDS = (*PAPER_SPEEDS[:-1], 30.0)
"""The paper's speeds (m/s): 10 to 60 mph, and 30 m/s instead of 67 mph."""
CURVE = 1.0 / 300.0
"""Curvature (1/m) of the curve on which steady cornering is reported."""
NOMINAL_HZ = 50
"""Default rate of control and inertial sensor; the lowest stable rates are searched below it."""
REPORT = "gains.json"


def gains_report(
    parameters: VehicleParameters,
    gains: Gains,
    speeds: Sequence[float] = DEFAULT_SPEEDS,
    loadings: Sequence[Loading] | None = None,
    out_dir: Path | None = None,
    *,
    picture_format: str | None = "png",
) -> Table:
    """Analyse `gains` over `speeds` (m/s) and `loadings` (paper, Sections III-F, IV, V-A and V-B).

    Writes gains.json into `out_dir`, if given, and plots unless `picture_format` is None (needs
    Matplotlib). Results at one speed refer to the fastest. Raises ValueError without a speed or a
    loading, and ScenarioError if gains.json exists and is not an earlier report.
    """
    loadings = all_loadings() if loadings is None else loadings
    if not speeds or not loadings:
        raise ValueError("the gains report needs at least one speed and one loading")
    if out_dir is not None:
        _refuse_foreign_files(out_dir, picture_format)
    subject = Subject(parameters, gains, sorted(speeds), loadings)
    report: Table = {
        "gains": gains,
        "reference_speed_mps": subject.reference,
        "stabilising_set": _stabilising_set(subject),
        "speeds": [_at_speed(subject, speed) for speed in subject.speeds],
        "loadings": [_at_loading(subject, loading) for loading in loadings],
        "varying_speed": _varying_speed(subject),
        "propagation": [_propagation_at(subject, speed) for speed in subject.speeds],
        "sampled": [_sampled_at(subject, speed) for speed in subject.speeds],
        "pictures": [],
    }
    if out_dir is not None:
        out_dir.mkdir(parents=True, exist_ok=True)
        if picture_format:
            from scenarios.studies.gains.plots import draw_all  # noqa: PLC0415 - brings matplotlib

            report["pictures"] = draw_all(subject, out_dir, picture_format)
    plain: Table = _as_json(report)
    if out_dir is not None:
        text = json.dumps(plain, indent=2, allow_nan=False)
        write_whole(out_dir / REPORT, f"{text}\n".encode())
    return plain


def _refuse_foreign_files(out_dir: Path, picture_format: str | None) -> None:
    """Raise ScenarioError if the report would overwrite anything but an earlier report."""
    path = out_dir / REPORT
    if not (path.exists() or path.is_symlink()):
        pictures = (out_dir / f"{name}.{picture_format}" for name in PICTURES)
        refuse_existing(*pictures, place="folder by --out")
        return
    try:
        is_report = "stabilising_set" in json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, TypeError):
        is_report = False
    if not is_report:
        raise ScenarioError(
            [f"{path}: exists and is not a gains report; give another folder by --out"]
        )


def _as_json(value: Any) -> Any:
    """Convert a result to JSON values; infinity and NaN become None."""
    match value:
        case Gains():
            names = ("lateral_rad_per_m", "heading_rad_per_rad", "yaw_rate_s")
            return dict(zip(names, value, strict=True))
        case dict():
            return {key: _as_json(entry) for key, entry in value.items()}
        case tuple() | list():
            return [_as_json(entry) for entry in value]
        case float():
            return value if isfinite(value) else None
    return value


def _stabilising_set(subject: Subject) -> Table:
    """Membership in the stabilising sets, their extent, and the margins (V-A)."""
    car, gains, speeds = subject.parameters, subject.gains, subject.speeds
    cars, reference = subject.cars, subject.reference
    table = {
        "inside_at_all_speeds": bool(stabilises_all([car], speeds, np.array(gains))),
        "inside_at_all_speeds_and_loadings": bool(stabilises_all(cars, speeds, np.array(gains))),
        "box_at_reference_speed": _box([car], [reference]),
        "box_over_speeds": _box([car], speeds),
        "box_over_speeds_and_loadings": _box(cars, speeds),
        "ball_at_reference_speed": _ball(
            stability_ball(car, reference, gains), "radius_in_gain_units"
        ),
        "ball_over_speeds_and_loadings": _ball(
            common_ball(cars, speeds, gains), "radius_in_gain_units"
        ),
        "not_convex_between": non_convex_pair([car], [reference]),
    }
    if all(gains):  # else a relative change is not defined
        table["relative_ball_at_reference_speed"] = _ball(
            stability_ball(car, reference, gains, gains), "radius_ratio"
        )
        table["relative_ball_over_speeds_and_loadings"] = _ball(
            common_ball(cars, speeds, gains, gains), "radius_ratio"
        )
    return table


def _box(cars: Sequence[VehicleParameters], speeds: Sequence[float]) -> Table:
    """Least and greatest gains of the set, which is bounded, or `members` raises ValueError."""
    names = ("lateral_rad_per_m", "heading_rad_per_rad", "yaw_rate_s")
    return {
        name: (least[axis], most[axis])
        for axis, (name, (least, most)) in enumerate(
            zip(names, gain_extremes(cars, speeds), strict=True)
        )
    }


def _ball(ball: Ball, radius: str) -> Table:
    names = (radius, "nearest_unstable", "root_there_radps", "limiting_speed_mps")
    return dict(zip(names, ball, strict=True))


def _at_speed(subject: Subject, speed: float) -> Table:
    """Decay, margin of the gains and steady cornering at one constant speed (m/s)."""
    lateral, heading = steady_cornering(subject.parameters, subject.gains, speed, CURVE)
    return {
        "speed_mps": speed,
        "abscissa_per_s": subject.abscissa(subject.parameters, speed),
        "ball_radius": stability_ball(subject.parameters, speed, subject.gains).radius,
        "steady_lateral_error_at_300_m_radius_m": lateral,
        "steady_heading_error_at_300_m_radius_rad": heading,
    }


def _at_loading(subject: Subject, loading: Loading) -> Table:
    """Roots (real, imaginary) and cornering of a loaded car at the reference speed (V-B)."""
    parameters, gains, speeds = subject.parameters, subject.gains, subject.speeds
    car, speed = loaded(parameters, loading), subject.reference
    roots = np.sort_complex(np.roots(characteristic_polynomial(car, gains, speed)))
    moved = loaded_with_moved_centre(parameters, loading)
    unknown_load = steady_cornering(car, gains, speed, CURVE, assumed=parameters)
    return {
        "front_passengers": loading.front_passengers,
        "rear_passengers": loading.rear_passengers,
        "mass_kg": car.mass,
        "yaw_inertia_kgm2": car.yaw_inertia,
        "roots_per_s": [(float(root.real), float(root.imag)) for root in roots],
        "abscissa_per_s": float(roots.real.max()),
        "stable_at_every_speed": is_stable_over(car, gains, speeds[0], speeds[-1]),
        "steady_lateral_error_at_300_m_radius_m": steady_cornering(car, gains, speed, CURVE)[0],
        "steady_lateral_error_unknown_load_m": unknown_load[0],
        "with_moved_centre": {
            "front_axle_distance_m": moved.front_axle_distance,
            "steer_gradient_s2_rad_per_m": moved.steer_gradient,
            "abscissa_per_s": subject.abscissa(moved, speed),
        },
    }


def _varying_speed(subject: Subject) -> Table:
    """Certified accelerations over speed (IV-A); the table is empty without a certificate."""
    parameters, gains = subject.parameters, subject.gains
    certificate = certify(parameters, gains)
    speeds = np.linspace(SLOWEST, FASTEST, 35).tolist() if certificate.holds else []
    decay, sensitivity = certificate.mean_bound()
    return {
        "slowest_mps": SLOWEST,
        "fastest_mps": FASTEST,
        "stable_at_every_speed": certificate.holds,
        "decay_per_s": guaranteed_decay(parameters, gains, SLOWEST, FASTEST),
        "q_diagonal": certificate.weights,
        "mean_acceleration_mps2": decay / sensitivity,
        "table": [
            {"speed_mps": speed, "certified_mps2": certificate.bound(speed)} for speed in speeds
        ],
    }


def _propagation_at(subject: Subject, speed: float) -> Table:
    """Propagation of errors with the predecessor's data only at one speed (IV-B)."""
    parameters, gains = subject.parameters, subject.gains
    if subject.abscissa(parameters, speed) >= 0.0:
        return {"speed_mps": speed, "stable": False}
    slow = peak(trace_propagation(parameters, gains, speed), LANE_CHANGE_BAND)
    return {
        "speed_mps": speed,
        "stable": True,
        "low_frequency_growth_s2": low_frequency_growth(parameters, gains, speed),
        "instantaneous": _amplification(subject, speed, "instantaneous"),
        "second_order": _amplification(subject, speed, "second order"),
        "traces": {
            "norm_below_1_hz_ratio": slow.magnitude,
            "peak_below_1_hz_radps": slow.frequency,
        },
    }


def _amplification(subject: Subject, speed: float, steering: SteeringModel) -> Table:
    """Norms of G and the bands it amplifies."""
    transfer = propagation(subject.parameters, subject.gains, speed, steering)
    whole, slow = peak(transfer), peak(transfer, LANE_CHANGE_BAND)
    return {
        "norm_ratio": whole.magnitude,
        "peak_radps": whole.frequency,
        "norm_below_1_hz_ratio": slow.magnitude,
        "peak_below_1_hz_radps": slow.frequency,
        "amplified_radps": amplified_band(transfer),
        "largest_alpha_ratio": largest_weight(transfer),
    }


def _sampled_at(subject: Subject, speed: float) -> Table:
    """Decay with control and inertial sensor at 50 Hz, and the lowest stable rates (whole Hz)."""
    nominal = SampledLoop(subject.parameters, subject.parameters, subject.gains)

    def lowest(loop_at: Callable[[float], SampledLoop]) -> int | None:
        return lowest_stable_rate(loop_at, speed, NOMINAL_HZ)

    return {
        "speed_mps": speed,
        "decay_per_s": sampled_decay(nominal, speed),
        "lowest_imu_rate_hz": lowest(lambda hz: replace(nominal, imu_hz=hz)),
        "lowest_rate_without_imu_hz": lowest(lambda hz: replace(nominal, imu_hz=hz, gnss_hz=hz)),
        "lowest_control_rate_hz": lowest(lambda hz: replace(nominal, imu_hz=hz, control_hz=hz)),
    }
