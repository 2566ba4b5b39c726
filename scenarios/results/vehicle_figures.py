"""The metrics of each vehicle, as functions of the run's tables.

A metric of vehicles is a field of `VehicleSummary` and a line in one of the functions below.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from math import inf
from typing import Any, Literal, NamedTuple

import numpy as np

from scenarios.definition.check.held_braking import TYRES
from scenarios.results.reaction import NO_REACTION, ReactionSummary, blind_distance, reaction
from scenarios.results.record import missing_poses, poses_of, silent_from_s
from scenarios.results.string_figures import NO_STRING, StringFigures, string_figures
from scenarios.results.tables import RunTables, common, once
from scenarios.results.traffic import overrides
from scenarios.results.true_motion import cross_track_error, gaps, road_error
from transport.columns import Columns, Floats, Integers
from vehicles.car.tyres import SLIDING_SHARE, linear_range


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleSummary:
    """Figures of one vehicle; None where there was nothing to measure."""

    name: str
    """Name of the vehicle; vehicles are in the order of the convoy."""
    role: Literal["lead", "follower"]
    """lead (the first vehicle) or follower."""
    poses: int
    """Number of GPS poses in the log."""
    missing_poses: int
    """Scheduled poses that are not in the log, until the vehicle stopped or the run ended. For
    vehicles that send without a schedule: missing message numbers."""
    silent_from_s: float | None = None
    """Time after which the run continued without records of the vehicle; else null."""
    lateral_error_m_max: float | None
    """Largest lateral error relative to the trajectory that the vehicle follows (self-estimate)."""
    lateral_error_m_rms: float | None
    """Root mean square of the same."""
    heading_error_rad_max: float | None
    """Largest heading error relative to the same trajectory (self-estimate)."""
    cross_track_error_m_max: float | None
    """Largest true distance from the path that the lead drove, once the vehicle has passed the
    lead's start; null for the lead."""
    cross_track_error_m_rms: float | None
    """Root mean square of the same."""
    cross_track_error_max_at_s: float | None = None
    """Time of the largest cross-track error."""
    road_error_m_max: float | None = None
    """Largest true distance from the road: the path of the scenario, or the vehicle's own drive if
    it is replayed."""
    road_error_m_rms: float | None = None
    """Root mean square of the same."""
    road_error_max_at_s: float | None = None
    """Time of the largest road error."""
    self_estimate_error_m_max: float | None = None
    """Largest difference between the self-estimated and the true lateral error, once the vehicle
    has a trajectory."""
    lateral_deviation_m_max: float | None = None
    """Largest estimated standard deviation of its own lateral position."""
    true_gap_m_min: float | None = None
    """Smallest true gap to the predecessor: shortest distance between the bodies, 0 in a
    collision."""
    true_gap_min_at_s: float | None = None
    """Time of the smallest true gap."""
    true_gap_m_max: float | None = None
    """Largest true gap to the predecessor."""
    true_gap_max_at_s: float | None = None
    """Time of the largest true gap."""
    estimated_gap_m_min: float | None
    """Smallest estimated gap to the predecessor, bumper to bumper along the path."""
    estimated_gap_m_max: float | None = None
    """Largest estimated gap to the predecessor."""
    held_braking_mps2_min: float | None = None
    """Smallest braking of the predecessor that the estimated gap held at the age of its data: from
    then on until it becomes known, with 8 m/s² of the own tyres (closed form, see `convoy check`).
    Null with a gap sensor."""
    overridden_ratio: float | None = None
    """Share of the time, after the first 2 s, in which the guard overrode the longitudinal law;
    null for the lead and without recorded commands."""
    overrides: Mapping[str, float] = field(default_factory=dict)
    """That share by reason: why the command differed from the law."""
    distance_m: float
    """Distance driven."""
    lateral_acceleration_mps2_max: float | None = None
    """Largest magnitude of the acceleration across the body."""
    front_slip_rad_max: float | None = None
    """Largest magnitude of the slip angle of the front axle."""
    rear_slip_rad_max: float | None = None
    """Largest magnitude of the slip angle of the rear axle."""
    friction_ratio_max: float | None = None
    """Largest share of the available friction that an axle used; more than 1 is possible with
    linear tyres only."""
    sliding_s: float | None = None
    """Time during which an axle used all of the available friction, or more."""
    string: StringFigures = NO_STRING
    """Errors along the string and their gains, see vehicles[].string."""
    own_figures: Mapping[str, float | None] = field(default_factory=dict)
    """Figures of the user's classes, by the name of the class."""
    ticks_by_mode: Mapping[str, int]
    """Number of steering commands by mode: path (the lead), composite, lead, predecessor, coast,
    stop or straight."""
    reaction: ReactionSummary = NO_REACTION
    """Reaction to missing messages, see vehicles[].reaction."""
    ticks: int
    """Executed instants of the vehicle's schedule, for control or GNSS."""
    late_ticks: int
    """Ticks that began more than half a control period late."""
    late_ticks_at_start: int = 0
    """Late ticks from the first one on: the vehicle started late."""
    late_ticks_by_network: int = 0
    """Late ticks after sending blocked; the others are due to the processor."""
    lateness_ms_max: float
    """Largest delay of a tick."""
    rejected_messages: int
    """Messages that the vehicle received and rejected."""
    memory_bytes_max: int
    """Memory of the vehicle's process; 0 in virtual time."""
    cpu_ratio: float
    """Mean share of one core that the vehicle's process used; 0 in virtual time."""
    finished: bool
    """Whether the final counters of the vehicle were received."""


# ---- Signals and their reductions


class Extremes(NamedTuple):
    """Largest magnitude of a signal, the row where it is first reached, and root mean square."""

    largest: float
    row: int
    rms: float


def extremes(values: Floats) -> Extremes | None:
    """Extremes of the values that are known; None without any."""
    (known,) = np.nonzero(~np.isnan(values))
    if not len(known):
        return None
    sizes = np.abs(values[known])
    row = int(np.argmax(sizes))
    return Extremes(float(sizes[row]), int(known[row]), float(np.sqrt(np.mean(sizes * sizes))))


def largest(values: Floats) -> float | None:
    """Largest magnitude of the values that are known; None without any."""
    found = extremes(values)
    return None if found is None else found.largest


class Signal(NamedTuple):
    """Values of a vehicle at instants (ns), NaN where they are unknown; shapes (N)."""

    at_ns: Integers
    values: Floats


def true_errors(run: RunTables, name: str) -> Signal:
    """Offset (m) from the lead's path."""
    return Signal(run.table(name, "truth").at_ns, cross_track_error(run, name))


def road_errors(run: RunTables, name: str) -> Signal:
    """Offset (m) from the road."""
    return Signal(run.table(name, "truth").at_ns, road_error(run, name))


def true_gaps(run: RunTables, name: str) -> Signal:
    """Distance (m) to the body ahead."""
    if name == run.lead:
        return Signal(np.zeros(0, np.int64), np.zeros(0))
    return Signal(*gaps(run, name)[:2])


def friction(run: RunTables, name: str) -> Signal:
    """Share of the available friction that an axle uses."""
    truth = run.table(name, "truth")
    return Signal(truth.at_ns, truth["friction_ratio"])


def blind_distances(run: RunTables, name: str) -> Signal:
    """Distance (m) driven so far beyond the known path."""
    return Signal(*blind_distance(run, name))


@once
def self_estimate_errors(run: RunTables, follower: str) -> Signal:
    """Difference (m) of estimated and true error, at decisions with a trajectory."""
    tracking, truth = run.table(follower, "tracking"), run.table(follower, "truth")
    mode = tracking["mode"]
    rows = np.flatnonzero((mode != "path") & (mode != "straight"))
    at, (estimates, trues) = common(tracking.at_ns[rows], truth.at_ns)
    estimated = tracking["lateral_error_m"][rows][estimates]
    return Signal(at, estimated - cross_track_error(run, follower)[trues])


# ---- Metrics of one vehicle


def vehicle_summaries(
    run: RunTables, own_figures: Mapping[str, Mapping[str, float | None]]
) -> tuple[VehicleSummary, ...]:
    """Summarise all vehicles; `own_figures` are those of the user's classes by vehicle."""
    string = string_figures(run, {name: position_deviation(run, name) for name in run.names})
    return tuple(
        VehicleSummary(
            name=name,
            role="lead" if name == run.lead else "follower",
            silent_from_s=silent_from_s(run, name),
            string=string[name],
            own_figures=own_figures.get(name, {}),
            **_of_poses(run, name),
            **_of_truth(run, name),
            **_of_decisions(run, name),
            **_of_process(run, name),
            **_of_follower(run, name),
        )
        for name in run.names
    )


def _of_poses(run: RunTables, name: str) -> dict[str, Any]:
    return {
        "poses": len(poses_of(run, name)),
        "missing_poses": missing_poses(run, name),
    }


def _of_truth(run: RunTables, name: str) -> dict[str, Any]:
    truth = run.table(name, "truth")
    tyres = {
        "lateral_acceleration_mps2_max": largest(truth["lateral_acceleration_mps2"]),
        "front_slip_rad_max": largest(truth["front_slip_rad"]),
        "rear_slip_rad_max": largest(truth["rear_slip_rad"]),
        "friction_ratio_max": largest(truth["friction_ratio"]),
    }
    sliding = np.count_nonzero(truth["friction_ratio"] >= SLIDING_SHARE)
    return {
        **tyres,
        **_of_errors(run, "road_error", road_errors(run, name)),
        "distance_m": float(truth["distance_m"][-1]) if len(truth) else 0.0,
        "sliding_s": sliding / run.scenario.control_rate_hz if len(truth) else None,
    }


def _of_errors(run: RunTables, metric: str, signal: Signal) -> dict[str, Any]:
    """Extremes of a signal (m) by the names of their fields."""
    found = extremes(signal.values)
    return {
        f"{metric}_m_max": found.largest if found else None,
        f"{metric}_m_rms": found.rms if found else None,
        f"{metric}_max_at_s": run.seconds(signal.at_ns[found.row]) if found else None,
    }


def _of_decisions(run: RunTables, name: str) -> dict[str, Any]:
    tracking = run.table(name, "tracking")
    own = extremes(tracking["lateral_error_m"])
    gap = tracking["estimated_gap_m"]
    known = gap[np.isfinite(gap)]
    deviation = lateral_deviation(tracking)
    return {
        "lateral_error_m_max": own.largest if own else None,
        "lateral_error_m_rms": own.rms if own else None,
        "heading_error_rad_max": largest(tracking["heading_error_rad"]),
        "lateral_deviation_m_max": deviation if deviation >= 0.0 else None,
        "estimated_gap_m_min": float(known.min()) if len(known) else None,
        "estimated_gap_m_max": float(known.max()) if len(known) else None,
        "held_braking_mps2_min": held_braking(tracking),
        "ticks_by_mode": dict(sorted(Counter(tracking["mode"].tolist()).items())),
    }


def lateral_deviation(tracking: Columns) -> float:
    """Largest standard deviation (m) that a vehicle estimates of its own offset; -1 if unknown."""
    return float(np.nanmax(tracking["lateral_deviation_m"], initial=-1.0))


def position_deviation(run: RunTables, name: str) -> float:
    """Largest standard deviation (m) of a vehicle's position: the receiver's, or its own estimate.

    Infinite if neither is recorded, as in an extract of true poses.
    """
    poses, own = run.table(name, "gps"), lateral_deviation(run.table(name, "tracking"))
    if not len(poses) and own < 0.0:
        return inf
    return max(float(np.nanmax(poses["position_accuracy_m"], initial=0.0)), own)


def held_braking(tracking: Columns) -> float | None:
    """Smallest braking (m/s²) of the vehicle ahead that a follower without a gap sensor held.

    See `scenarios.definition.check.held_braking.braking_held`.
    """
    rows = np.isnan(tracking["measured_gap_m"])
    gap, unknown = tracking["estimated_gap_m"][rows], tracking["predecessor_age_s"][rows]
    with np.errstate(invalid="ignore", divide="ignore"):
        held = np.where(gap <= 0.0, 0.0, gap * TYRES / (gap + 0.5 * TYRES * unknown * unknown))
    known = held[np.isfinite(held)]
    return float(known.min()) if len(known) else None


def _of_process(run: RunTables, name: str) -> dict[str, Any]:
    health = run.table(name, "health")
    counters = ("ticks", "late_ticks", "late_ticks_at_start", "late_ticks_by_network")
    last: dict[str, Any] = {
        key: health[key][-1].item() if len(health) else 0
        for key in (*counters, "lateness_ms_max", "rejected_messages")
    }
    whole = (health["seq"] > 0) & ~health["final"]  # those cover a second, first and last less
    cpu = health["cpu_ratio"][whole]
    return last | {
        "memory_bytes_max": int(health["memory_bytes"].max(initial=0)),
        "cpu_ratio": float(cpu.mean()) if len(cpu) else 0.0,
        "finished": bool(len(health) and health["final"][-1]),
    }


def _of_follower(run: RunTables, name: str) -> dict[str, Any]:
    if name == run.lead:
        nothing = ("cross_track_error_m_max", "cross_track_error_m_rms")
        return dict.fromkeys(nothing)
    at, gap = true_gaps(run, name)
    override = overrides(run, name)
    result: dict[str, Any] = {
        **_of_errors(run, "cross_track_error", true_errors(run, name)),
        "self_estimate_error_m_max": largest(self_estimate_errors(run, name).values),
        "reaction": reaction(run, name),
        "overridden_ratio": override.ratio,
        "overrides": override.ratios,
    }
    if len(gap):
        low, high = int(np.argmin(gap)), int(np.argmax(gap))
        result |= {
            "true_gap_m_min": float(gap[low]),
            "true_gap_min_at_s": run.seconds(at[low]),
            "true_gap_m_max": float(gap[high]),
            "true_gap_max_at_s": run.seconds(at[high]),
        }
    return result


def tyre_warnings(run: RunTables) -> dict[str, tuple[int, str]]:
    """Vehicles whose tyres left their linear range, in order of time: the instant (ns), a line."""
    found = {}
    for name in run.names:
        front, rear = linear_range(run.scenario.vehicle(name).parameters)
        truth = run.table(name, "truth")
        beyond = np.abs(truth["front_slip_rad"]) > front
        (rows,) = np.nonzero(beyond | (np.abs(truth["rear_slip_rad"]) > rear))
        if len(rows):
            at = int(truth.at_ns[rows[0]])
            found[name] = (
                at,
                f"{name}: tyres beyond their linear range of {front:.4f} rad of slip in front, "
                f"{rear:.4f} rad at the rear, from {run.seconds(at):.2f} s after the start",
            )
    return dict(sorted(found.items(), key=lambda entry: entry[1][0]))


# ---- Errors along the string as a table: a row per follower


@dataclass(frozen=True, slots=True, kw_only=True)
class StringError:
    """Errors and gains of one vehicle; `number` counts from 1, the lead."""

    vehicle: str
    number: int
    error_m_max: float | None
    """Largest true error of the whole run: cross_track_error_m_max of the summary."""
    error_m_rms: float | None
    """Root mean square of the same: cross_track_error_m_rms."""
    figures: StringFigures
    """Norms and gains over the places and times that all vehicles have in common."""

    def row(self) -> dict[str, Any]:
        """All figures by name, those of `figures` too."""
        row = asdict(self)
        figures: dict[str, Any] = row.pop("figures")
        return row | figures


STRING_COLUMNS = (
    *(field.name for field in fields(StringError) if field.name != "figures"),
    *(field.name for field in fields(StringFigures)),
)


def string_errors(vehicles: Sequence[VehicleSummary]) -> tuple[StringError, ...]:
    """Errors and gains of the followers, in the order of the convoy."""
    return tuple(
        StringError(
            vehicle=row.name,
            number=number,
            error_m_max=row.cross_track_error_m_max,
            error_m_rms=row.cross_track_error_m_rms,
            figures=row.string,
        )
        for number, row in enumerate(vehicles, 1)
        if row.role != "lead"
    )
