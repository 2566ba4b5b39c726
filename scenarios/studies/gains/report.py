"""`convoy gains`: analysis of one choice of steering gains, as JSON and plots."""

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from scenarios.definition.errors import ScenarioError
from scenarios.results.files import write_whole
from scenarios.studies.gains.results import (
    Amplification,
    AtLoading,
    AtSpeed,
    CertifiedAt,
    GainBall,
    GainBox,
    GainsReport,
    MovedCentre,
    PropagationAt,
    RelativeGainBall,
    SampledAt,
    StabilisingSet,
    Subject,
    TraceAmplification,
    VaryingSpeed,
    as_json,
)
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
    abscissa,
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
from vehicles.theory.string_stability import (
    LANE_CHANGE_BAND,
    amplified_band,
    largest_weight,
    peak,
)
from vehicles.theory.varying_speed import FASTEST, SLOWEST, certify

DEFAULT_SPEEDS = (*PAPER_SPEEDS[:-1], 30.0)
"""The paper's speeds (m/s): 10 to 60 mph, and 30 m/s instead of 67 mph."""

CURVE = 1.0 / 300.0
"""Curvature (1/m) of the curve on which steady cornering is reported."""

NOMINAL_HZ = 50
"""Default rate of control and inertial sensor; the lowest stable rates are searched below it."""

REPORT = "gains.json"


def refuse_foreign_files(out_dir: Path, picture_format: str | None = "png") -> None:
    """Raise ScenarioError if the report would overwrite anything but an earlier report.

    An earlier report is recognised by the fields of its gains.json.
    """
    path = out_dir / REPORT
    if path.exists() or path.is_symlink():
        try:
            existing = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            existing = None
        names = {field.name for field in fields(GainsReport)}
        if isinstance(existing, dict) and names == existing.keys():
            return
        raise ScenarioError(
            [f"{path}: exists and is not a gains report; give another folder by --out"]
        )
    if picture_format:
        from scenarios.studies.gains.plots import NAMES  # noqa: PLC0415 - brings matplotlib

        for picture in (out_dir / f"{name}.{picture_format}" for name in NAMES):
            if picture.exists() or picture.is_symlink():
                raise ScenarioError(
                    [f"{picture}: exists without {REPORT}; give another folder by --out"]
                )


def gains_report(
    parameters: VehicleParameters,
    gains: Gains,
    speeds: Sequence[float] = DEFAULT_SPEEDS,
    loadings: Sequence[Loading] | None = None,
    out_dir: Path | None = None,
    *,
    picture_format: str | None = "png",
) -> GainsReport:
    """Analyse `gains` over `speeds` (m/s) and `loadings` (paper, Sections III-F, IV, V-A and V-B).

    Writes gains.json into `out_dir`, if given, and plots unless `picture_format` is None (needs
    Matplotlib). Results at one speed refer to the fastest. Raises ValueError without a speed or a
    loading.
    """
    if out_dir is not None:
        refuse_foreign_files(out_dir, picture_format)
        out_dir.mkdir(parents=True, exist_ok=True)
    loadings = all_loadings() if loadings is None else loadings
    if not speeds or not loadings:
        raise ValueError("the gains report needs at least one speed and one loading")
    subject = Subject(parameters, gains, sorted(speeds), loadings)
    report = GainsReport(
        gains=gains,
        reference_speed_mps=subject.reference,
        stabilising_set=_stabilising_set(subject),
        speeds=tuple(_at_speed(subject, speed) for speed in subject.speeds),
        loadings=tuple(_at_loading(subject, loading) for loading in loadings),
        varying_speed=_varying_speed(subject),
        propagation=tuple(_propagation_at(subject, speed) for speed in subject.speeds),
        sampled=tuple(_sampled_at(subject, speed) for speed in subject.speeds),
    )
    if out_dir is not None:
        if picture_format:
            from scenarios.studies.gains.plots import draw_all  # noqa: PLC0415 - brings matplotlib

            report = replace(report, pictures=draw_all(subject, out_dir, picture_format))
        text = json.dumps(as_json(report), indent=2, allow_nan=False)
        write_whole(out_dir / REPORT, f"{text}\n".encode())
    return report


def _stabilising_set(subject: Subject) -> StabilisingSet:
    """Compute membership in the stabilising sets, their extent, and the margins (V-A)."""
    parameters, gains, speeds = subject.parameters, subject.gains, subject.speeds
    cars, reference = subject.cars, subject.reference
    relative_at_reference = relative_over_all = None
    if all(gains):
        relative_at_reference = RelativeGainBall(
            *stability_ball(parameters, reference, gains, gains)
        )
        relative_over_all = RelativeGainBall(*common_ball(cars, speeds, gains, gains))
    return StabilisingSet(
        inside_at_all_speeds=bool(stabilises_all([parameters], speeds, np.array(gains))),
        inside_at_all_speeds_and_loadings=bool(stabilises_all(cars, speeds, np.array(gains))),
        box_at_reference_speed=_box([parameters], [reference]),
        box_over_speeds=_box([parameters], speeds),
        box_over_speeds_and_loadings=_box(cars, speeds),
        ball_at_reference_speed=GainBall(*stability_ball(parameters, reference, gains)),
        ball_over_speeds_and_loadings=GainBall(*common_ball(cars, speeds, gains)),
        not_convex_between=non_convex_pair([parameters], [reference]),
        relative_ball_at_reference_speed=relative_at_reference,
        relative_ball_over_speeds_and_loadings=relative_over_all,
    )


def _box(cars: Sequence[VehicleParameters], speeds: Sequence[float]) -> GainBox:
    """Least and greatest gains of the set, which is bounded, or `members` raises ValueError."""
    lateral, heading, yaw_rate = gain_extremes(cars, speeds)
    return GainBox(
        lateral_rad_per_m=(lateral[0].lateral, lateral[1].lateral),
        heading_rad_per_rad=(heading[0].heading, heading[1].heading),
        yaw_rate_s=(yaw_rate[0].yaw_rate, yaw_rate[1].yaw_rate),
    )


def _at_speed(subject: Subject, speed: float) -> AtSpeed:
    """Results at one constant speed (m/s), including steady cornering at 300 m radius."""
    parameters, gains = subject.parameters, subject.gains
    lateral, heading = steady_cornering(parameters, gains, speed, CURVE)
    return AtSpeed(
        speed_mps=speed,
        abscissa_per_s=float(abscissa(parameters, gains, [speed])[0]),
        ball_radius=stability_ball(parameters, speed, gains).radius,
        steady_lateral_error_at_300_m_radius_m=lateral,
        steady_heading_error_at_300_m_radius_rad=heading,
    )


def _at_loading(subject: Subject, loading: Loading) -> AtLoading:
    """Roots and cornering of a loaded car at the reference speed (V-B)."""
    parameters, gains, speeds = subject.parameters, subject.gains, subject.speeds
    car, speed = loaded(parameters, loading), subject.reference
    roots = np.sort_complex(np.roots(characteristic_polynomial(car, gains, speed)))
    moved = loaded_with_moved_centre(parameters, loading)
    unknown_load = steady_cornering(car, gains, speed, CURVE, assumed=parameters)
    return AtLoading(
        front_passengers=loading.front_passengers,
        rear_passengers=loading.rear_passengers,
        mass_kg=car.mass,
        yaw_inertia_kgm2=car.yaw_inertia,
        roots_per_s=tuple((float(root.real), float(root.imag)) for root in roots),
        abscissa_per_s=float(roots.real.max()),
        stable_at_every_speed=is_stable_over(car, gains, speeds[0], speeds[-1]),
        steady_lateral_error_at_300_m_radius_m=steady_cornering(car, gains, speed, CURVE)[0],
        steady_lateral_error_unknown_load_m=unknown_load[0],
        with_moved_centre=MovedCentre(
            front_axle_distance_m=moved.front_axle_distance,
            steer_gradient_s2_rad_per_m=moved.steer_gradient,
            abscissa_per_s=float(abscissa(moved, gains, [speed])[0]),
        ),
    )


def _varying_speed(subject: Subject) -> VaryingSpeed:
    """Tabulate the certified accelerations over speed (IV-A)."""
    parameters, gains = subject.parameters, subject.gains
    certificate = certify(parameters, gains)
    speeds = np.linspace(SLOWEST, FASTEST, 35).tolist() if certificate.holds else []
    decay, sensitivity = certificate.mean_bound()
    return VaryingSpeed(
        slowest_mps=SLOWEST,
        fastest_mps=FASTEST,
        stable_at_every_speed=certificate.holds,
        decay_per_s=guaranteed_decay(parameters, gains, SLOWEST, FASTEST),
        q_diagonal=certificate.weights,
        mean_acceleration_mps2=decay / sensitivity,
        table=tuple(CertifiedAt(speed, certificate.bound(speed)) for speed in speeds),
    )


def _propagation_at(subject: Subject, speed: float) -> PropagationAt:
    """Propagation of errors at one speed (IV-B)."""
    parameters, gains = subject.parameters, subject.gains
    if float(abscissa(parameters, gains, [speed])[0]) >= 0.0:
        return PropagationAt(speed, stable=False)
    slow = peak(trace_propagation(parameters, gains, speed), LANE_CHANGE_BAND)
    return PropagationAt(
        speed_mps=speed,
        stable=True,
        low_frequency_growth_s2=low_frequency_growth(parameters, gains, speed),
        instantaneous=_amplification(subject, speed, "instantaneous"),
        second_order=_amplification(subject, speed, "second order"),
        traces=TraceAmplification(slow.magnitude, slow.frequency),
    )


def _amplification(subject: Subject, speed: float, steering: SteeringModel) -> Amplification:
    """Norms of G and the bands it amplifies."""
    transfer = propagation(subject.parameters, subject.gains, speed, steering)
    whole, slow = peak(transfer), peak(transfer, LANE_CHANGE_BAND)
    return Amplification(
        norm_ratio=whole.magnitude,
        peak_radps=whole.frequency,
        norm_below_1_hz_ratio=slow.magnitude,
        peak_below_1_hz_radps=slow.frequency,
        amplified_radps=tuple(amplified_band(transfer)),
        largest_alpha_ratio=largest_weight(transfer),
    )


def _sampled_at(subject: Subject, speed: float) -> SampledAt:
    """Decay at the default rates, and the lowest stable rates, at one speed."""
    nominal = SampledLoop(subject.parameters, subject.parameters, subject.gains)
    return SampledAt(
        speed_mps=speed,
        decay_per_s=sampled_decay(nominal, speed),
        lowest_imu_rate_hz=lowest_stable_rate(
            lambda rate: replace(nominal, imu_hz=rate), speed, NOMINAL_HZ
        ),
        lowest_rate_without_imu_hz=lowest_stable_rate(
            lambda rate: replace(nominal, imu_hz=rate, gnss_hz=rate), speed, NOMINAL_HZ
        ),
        lowest_control_rate_hz=lowest_stable_rate(
            lambda rate: replace(nominal, imu_hz=rate, control_hz=rate), speed, NOMINAL_HZ
        ),
    )
