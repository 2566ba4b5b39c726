"""The metrics of each vehicle, as functions of the run's tables.

A metric of vehicles is a field of `VehicleSummary`: a signal and a reduction of it, or a line in
one of the functions below.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import inf
from typing import Any, Literal

import numpy as np

from scenarios.definition.check.held_braking import TYRES
from scenarios.results.reaction import NO_REACTION, ReactionSummary, blind_distance, reaction
from scenarios.results.record import missing_poses, poses_of, silent_from_s
from scenarios.results.string_figures import NO_STRING, STRING_DOCS, StringFigures, string_figures
from scenarios.results.tables import RunTables, Signal, common, once
from scenarios.results.traffic import overrides
from scenarios.results.true_motion import cross_track_error, gaps, road_error
from transport.columns import Floats
from vehicles.car.tyres import SLIDING_SHARE, linear_range

# ---- Signals: values of a vehicle over time


SignalOf = Callable[[RunTables, str], Signal]
NO_SIGNAL = Signal(np.zeros(0, np.int64), np.zeros(0))


def field_of(topic: str, name: str) -> SignalOf:
    """Signal of a field of the messages of a topic."""

    def signal(run: RunTables, vehicle: str) -> Signal:
        table = run.table(vehicle, topic)
        return Signal(table.at_ns, table[name])

    return signal


def true_errors(run: RunTables, name: str) -> Signal:
    """Offset (m) of a follower from the lead's path."""
    if name == run.lead:
        return NO_SIGNAL
    return Signal(run.table(name, "truth").at_ns, cross_track_error(run, name))


def road_errors(run: RunTables, name: str) -> Signal:
    """Offset (m) from the road."""
    return Signal(run.table(name, "truth").at_ns, road_error(run, name))


def true_gaps(run: RunTables, name: str) -> Signal:
    """Distance (m) to the body ahead."""
    return NO_SIGNAL if name == run.lead else Signal(*gaps(run, name)[:2])


def estimated_gaps(run: RunTables, name: str) -> Signal:
    """Estimated gap (m), bumper to bumper."""
    tracking = run.table(name, "tracking")
    gap = tracking["estimated_gap_m"]
    return Signal(tracking.at_ns, np.where(np.isfinite(gap), gap, np.nan))


def blind_distances(run: RunTables, name: str) -> Signal:
    """Distance (m) driven so far beyond the known path."""
    return Signal(*blind_distance(run, name))


@once
def self_estimate_errors(run: RunTables, follower: str) -> Signal:
    """Difference (m) of estimated and true error, at decisions with a trajectory."""
    if follower == run.lead:
        return NO_SIGNAL
    tracking, truth = run.table(follower, "tracking"), run.table(follower, "truth")
    mode = tracking["mode"]
    rows = np.flatnonzero((mode != "path") & (mode != "straight"))
    at, (estimates, trues) = common(tracking.at_ns[rows], truth.at_ns)
    estimated = tracking["lateral_error_m"][rows][estimates]
    return Signal(at, estimated - cross_track_error(run, follower)[trues])


def held_brakings(run: RunTables, name: str) -> Signal:
    """Braking (m/s²) of the vehicle ahead that a follower without a gap sensor held.

    See `scenarios.definition.check.held_braking.braking_held`.
    """
    tracking = run.table(name, "tracking")
    gap, unknown = tracking["estimated_gap_m"], tracking["predecessor_age_s"]
    with np.errstate(invalid="ignore", divide="ignore"):
        held = np.where(gap <= 0.0, 0.0, gap * TYRES / (gap + 0.5 * TYRES * unknown * unknown))
    known = np.isfinite(held) & np.isnan(tracking["measured_gap_m"])
    return Signal(tracking.at_ns, np.where(known, held, np.nan))


friction = field_of("truth", "friction_ratio")
own_deviations = field_of("tracking", "lateral_deviation_m")


# ---- Reductions of a signal to a number; None without known values


Reduction = Callable[[RunTables, Signal], float | None]


def _value(reduce: Callable[[Floats], Any]) -> Reduction:
    def reduction(_: RunTables, signal: Signal) -> float | None:
        values = signal.known.values
        return float(reduce(values)) if len(values) else None

    return reduction


def _at(row_of: Callable[[Floats], Any]) -> Reduction:
    def reduction(run: RunTables, signal: Signal) -> float | None:
        at, values = signal.known
        return run.seconds(at[row_of(values)]) if len(values) else None

    return reduction


largest = _value(lambda values: np.abs(values).max())
rms = _value(lambda values: np.sqrt(np.mean(np.abs(values) ** 2)))
least, most = _value(np.min), _value(np.max)
largest_at = _at(lambda values: np.argmax(np.abs(values)))
least_at, most_at = _at(np.argmin), _at(np.argmax)


def metric(signal: SignalOf, reduce: Reduction) -> Any:
    """A field of a summary that is a reduction of a signal."""
    return field(default=None, metadata={METRIC: (signal, reduce)})


METRIC = "metric"


# ---- Summary


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
    lateral_error_m_max: float | None = metric(field_of("tracking", "lateral_error_m"), largest)
    """Largest lateral error relative to the trajectory that the vehicle follows (self-estimate)."""
    lateral_error_m_rms: float | None = metric(field_of("tracking", "lateral_error_m"), rms)
    """Root mean square of the same."""
    heading_error_rad_max: float | None = metric(field_of("tracking", "heading_error_rad"), largest)
    """Largest heading error relative to the same trajectory (self-estimate)."""
    cross_track_error_m_max: float | None = metric(true_errors, largest)
    """Largest true distance from the path that the lead drove, once the vehicle has passed the
    lead's start; null for the lead."""
    cross_track_error_m_rms: float | None = metric(true_errors, rms)
    """Root mean square of the same."""
    cross_track_error_max_at_s: float | None = metric(true_errors, largest_at)
    """Time of the largest cross-track error."""
    road_error_m_max: float | None = metric(road_errors, largest)
    """Largest true distance from the road: the path of the scenario, or the vehicle's own drive if
    it is replayed."""
    road_error_m_rms: float | None = metric(road_errors, rms)
    """Root mean square of the same."""
    road_error_max_at_s: float | None = metric(road_errors, largest_at)
    """Time of the largest road error."""
    self_estimate_error_m_max: float | None = metric(self_estimate_errors, largest)
    """Largest difference between the self-estimated and the true lateral error, once the vehicle
    has a trajectory."""
    lateral_deviation_m_max: float | None = metric(own_deviations, most)
    """Largest estimated standard deviation of its own lateral position."""
    true_gap_m_min: float | None = metric(true_gaps, least)
    """Smallest true gap to the predecessor: shortest distance between the bodies, 0 in a
    collision."""
    true_gap_min_at_s: float | None = metric(true_gaps, least_at)
    """Time of the smallest true gap."""
    true_gap_m_max: float | None = metric(true_gaps, most)
    """Largest true gap to the predecessor."""
    true_gap_max_at_s: float | None = metric(true_gaps, most_at)
    """Time of the largest true gap."""
    estimated_gap_m_min: float | None = metric(estimated_gaps, least)
    """Smallest estimated gap to the predecessor, bumper to bumper along the path."""
    estimated_gap_m_max: float | None = metric(estimated_gaps, most)
    """Largest estimated gap to the predecessor."""
    held_braking_mps2_min: float | None = metric(held_brakings, least)
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
    lateral_acceleration_mps2_max: float | None = metric(
        field_of("truth", "lateral_acceleration_mps2"), largest
    )
    """Largest magnitude of the acceleration across the body."""
    front_slip_rad_max: float | None = metric(field_of("truth", "front_slip_rad"), largest)
    """Largest magnitude of the slip angle of the front axle."""
    rear_slip_rad_max: float | None = metric(field_of("truth", "rear_slip_rad"), largest)
    """Largest magnitude of the slip angle of the rear axle."""
    friction_ratio_max: float | None = metric(friction, largest)
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


# ---- Metrics of one vehicle


def vehicle_summaries(
    run: RunTables, own_figures: Mapping[str, Mapping[str, float | None]]
) -> tuple[VehicleSummary, ...]:
    """Summarise all vehicles; `own_figures` are those of the user's functions by vehicle."""
    string = string_figures(run, {name: position_deviation(run, name) for name in run.names})
    return tuple(
        VehicleSummary(
            name=name,
            role="lead" if name == run.lead else "follower",
            poses=len(poses_of(run, name)),
            missing_poses=missing_poses(run, name),
            silent_from_s=silent_from_s(run, name),
            string=string[name],
            own_figures=own_figures.get(name, {}),
            **_reduced(run, name),
            **_counts(run, name),
            **_of_process(run, name),
            **_of_follower(run, name),
        )
        for name in run.names
    )


def _reduced(run: RunTables, name: str) -> dict[str, Any]:
    metrics = {one.name: one.metadata.get(METRIC) for one in fields(VehicleSummary)}
    return {key: of[1](run, of[0](run, name)) for key, of in metrics.items() if of}


def _counts(run: RunTables, name: str) -> dict[str, Any]:
    truth, modes = run.table(name, "truth"), run.table(name, "tracking")["mode"]
    sliding = np.count_nonzero(truth["friction_ratio"] >= SLIDING_SHARE)
    return {
        "distance_m": float(truth["distance_m"][-1]) if len(truth) else 0.0,
        "sliding_s": sliding / run.scenario.control_rate_hz if len(truth) else None,
        "ticks_by_mode": dict(sorted(Counter(modes.tolist()).items())),
    }


def position_deviation(run: RunTables, name: str) -> float:
    """Largest standard deviation (m) of a vehicle's position: the receiver's, or its own estimate.

    Infinite if neither is recorded, as in an extract of true poses.
    """
    poses, own = run.table(name, "gps"), own_deviations(run, name).known.values
    if not len(poses) and not len(own):
        return inf
    received = np.nanmax(poses["position_accuracy_m"], initial=0.0)
    return float(max(received, own.max(initial=-1.0)))


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
        return {}
    override = overrides(run, name)
    return {
        "reaction": reaction(run, name),
        "overridden_ratio": override.ratio,
        "overrides": override.ratios,
    }


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


STRING_COLUMNS = ("vehicle", "number", "error_m_max", "error_m_rms", *STRING_DOCS)


def string_rows(vehicles: Sequence[VehicleSummary]) -> list[dict[str, Any]]:
    """Errors and gains of the followers, in the order of the convoy.

    `number` counts from 1, the lead. The errors are those of the whole run, cross_track_error_m_max
    and _rms of the summary; norms and gains are over what all vehicles have in common.
    """
    return [
        {
            "vehicle": row.name,
            "number": number,
            "error_m_max": row.cross_track_error_m_max,
            "error_m_rms": row.cross_track_error_m_rms,
            **{name: getattr(row.string, name) for name in STRING_DOCS},
        }
        for number, row in enumerate(vehicles, 1)
        if row.role != "lead"
    ]
