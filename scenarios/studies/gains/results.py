"""Typed results of `convoy gains`, one class per section, and their JSON form.

Field names are the keys of gains.json. A field with a default is omitted if it is None; any other
None is null.
"""

import math
from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from typing import Any

from vehicles.car.parameters import Gains, Loading, VehicleParameters, loaded

Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Subject:
    """Car, gains, speeds (m/s, ascending; the last is the reference) and loadings to analyse."""

    parameters: VehicleParameters
    gains: Gains
    speeds: Sequence[float]
    loadings: Sequence[Loading]

    @property
    def reference(self) -> float:
        return self.speeds[-1]

    @property
    def cars(self) -> list[VehicleParameters]:
        return [loaded(self.parameters, loading) for loading in self.loadings]


@dataclass(frozen=True, slots=True)
class GainBox:
    """Smallest and largest gains of a stabilising set."""

    lateral_rad_per_m: Interval
    heading_rad_per_rad: Interval
    yaw_rate_s: Interval


@dataclass(frozen=True, slots=True)
class GainBall:
    """Largest ball of stabilising gains around the chosen ones, in the units of the gains."""

    radius_in_gain_units: float
    nearest_unstable: Gains
    root_there_radps: float
    limiting_speed_mps: float


@dataclass(frozen=True, slots=True)
class RelativeGainBall:
    """Largest ball of stabilising gains, relative to the chosen gains."""

    radius_ratio: float
    nearest_unstable: Gains
    root_there_radps: float
    limiting_speed_mps: float


@dataclass(frozen=True, slots=True)
class StabilisingSet:
    """Membership in the stabilising sets, their extent, and margins.

    Relative balls are None if one of the gains is zero.
    """

    inside_at_all_speeds: bool
    inside_at_all_speeds_and_loadings: bool
    box_at_reference_speed: GainBox
    box_over_speeds: GainBox
    box_over_speeds_and_loadings: GainBox
    ball_at_reference_speed: GainBall
    ball_over_speeds_and_loadings: GainBall
    not_convex_between: tuple[Gains, Gains] | None
    relative_ball_at_reference_speed: RelativeGainBall | None = None
    relative_ball_over_speeds_and_loadings: RelativeGainBall | None = None


@dataclass(frozen=True, slots=True)
class AtSpeed:
    """Decay, margin of the gains and steady cornering at one constant speed."""

    speed_mps: float
    abscissa_per_s: float
    ball_radius: float
    steady_lateral_error_at_300_m_radius_m: float
    steady_heading_error_at_300_m_radius_rad: float


@dataclass(frozen=True, slots=True)
class MovedCentre:
    front_axle_distance_m: float
    steer_gradient_s2_rad_per_m: float
    abscissa_per_s: float


@dataclass(frozen=True, slots=True)
class AtLoading:
    """Results for one loading at the reference speed; roots as (real, imaginary)."""

    front_passengers: int
    rear_passengers: int
    mass_kg: float
    yaw_inertia_kgm2: float
    roots_per_s: tuple[tuple[float, float], ...]
    abscissa_per_s: float
    stable_at_every_speed: bool
    steady_lateral_error_at_300_m_radius_m: float
    steady_lateral_error_unknown_load_m: float
    with_moved_centre: MovedCentre


@dataclass(frozen=True, slots=True)
class CertifiedAt:
    """Certified acceleration at one speed, for braking and accelerating alike."""

    speed_mps: float
    certified_mps2: float


@dataclass(frozen=True, slots=True)
class VaryingSpeed:
    """Certified accelerations between two speeds; the table is empty without a certificate.

    `mean_acceleration_mps2` is the bound on the mean of |v'|, 0 without a certificate.
    """

    slowest_mps: float
    fastest_mps: float
    stable_at_every_speed: bool
    decay_per_s: float
    q_diagonal: tuple[float, ...]
    mean_acceleration_mps2: float
    table: tuple[CertifiedAt, ...]


@dataclass(frozen=True, slots=True)
class Amplification:
    """Amplification of errors with the predecessor's data only, for one steering model."""

    norm_ratio: float
    peak_radps: float
    norm_below_1_hz_ratio: float
    peak_below_1_hz_radps: float
    amplified_radps: tuple[Interval, ...]
    largest_alpha_ratio: float


@dataclass(frozen=True, slots=True)
class TraceAmplification:
    """Amplification of errors by a car that steers along its predecessor's path."""

    norm_below_1_hz_ratio: float
    peak_below_1_hz_radps: float


@dataclass(frozen=True, slots=True)
class PropagationAt:
    """Propagation of errors at one speed; None values for an unstable loop."""

    speed_mps: float
    stable: bool
    low_frequency_growth_s2: float | None = None
    instantaneous: Amplification | None = None
    second_order: Amplification | None = None
    traces: TraceAmplification | None = None


@dataclass(frozen=True, slots=True)
class SampledAt:
    """Stability of the sampled loop at one speed, with control and inertial sensor at 50 Hz.

    `decay_per_s` is negative if errors grow. The lowest stable rates are whole Hz up to 50, None if
    unstable at 50 Hz: of the inertial sensor, of fixes without an inertial sensor, and of control
    and inertial sensor together.
    """

    speed_mps: float
    decay_per_s: float
    lowest_imu_rate_hz: int | None
    lowest_rate_without_imu_hz: int | None
    lowest_control_rate_hz: int | None


@dataclass(frozen=True, slots=True)
class GainsReport:
    """All results of `convoy gains`; `pictures` holds the file names of the plots."""

    gains: Gains
    reference_speed_mps: float
    stabilising_set: StabilisingSet
    speeds: tuple[AtSpeed, ...]
    loadings: tuple[AtLoading, ...]
    varying_speed: VaryingSpeed
    propagation: tuple[PropagationAt, ...]
    sampled: tuple[SampledAt, ...]
    pictures: tuple[str, ...] = ()


def as_json(value: Any) -> Any:
    """Convert a result to JSON values; infinity and NaN become null."""
    match value:
        case Gains():
            return {
                "lateral_rad_per_m": value.lateral,
                "heading_rad_per_rad": value.heading,
                "yaw_rate_s": value.yaw_rate,
            }
        case tuple():
            return [as_json(entry) for entry in value]
        case float():
            return value if math.isfinite(value) else None
    if not is_dataclass(value):
        return value
    entries: dict[str, Any] = {}
    for field in fields(value):
        entry = getattr(value, field.name)
        if entry is not None or field.default is MISSING:
            entries[field.name] = as_json(entry)
    return entries
