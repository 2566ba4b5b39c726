"""The figures of one vehicle: gathered and summarised.

A figure of vehicles is a field of `VehicleSummary`, a value that `VehicleFigures` keeps, and a line
in its `summary`.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from math import inf, isfinite, isnan
from typing import Any, Literal, NamedTuple

from scenarios.definition.check.held_braking import braking_held
from scenarios.results.accumulators import Extremes, SelfEstimateErrors, TyreFigures
from scenarios.results.encounters import TrueGap
from scenarios.results.holes import (
    RecordedSeries,
    RecordHole,
    UnseenSpan,
    expected_poses,
    holes_of,
)
from scenarios.results.reaction import NO_REACTION, Reaction, ReactionSummary
from scenarios.results.string_figures import NO_STRING, StringFigures
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import GpsPose, Health, Tracking, TruePose
from vehicles.schedule import SECOND

USUAL_RATE_HZ, USUAL_CONTROL_RATE_HZ = 20.0, 50.0
LONGEST_STEP = 1.5
"""Time, in control periods, between two recorded true poses without a hole."""
SILENT_NS = SECOND
"""A vehicle without records for this time before the end had left; messages in transit at a stop
take less."""


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


class RunSpan(NamedTuple):
    """Start of a run (ns, None if not recorded), its duration and planned duration."""

    start_at: int | None
    ran_ns: int
    planned_ns: int


class VehicleFigures:
    """Gathers the figures of one vehicle."""

    def __init__(
        self,
        name: str,
        *,
        is_lead: bool,
        rate_hz: float | None = USUAL_RATE_HZ,
        control_rate_hz: float = USUAL_CONTROL_RATE_HZ,
    ) -> None:
        """`rate_hz` is that of its GPS poses, None without a schedule of sending."""
        self.name = name
        self.is_lead = is_lead
        self.rate_hz = rate_hz
        self._control_rate_hz = control_rate_hz
        self.sent, self.truth = RecordedSeries(), RecordedSeries()
        self.decisions = RecordedSeries()
        self.ends_early = False
        self._first_sent_at: int | None = None
        self.last_at = 0
        self.distance = self.speed = 0.0
        self.mode = ""
        self.modes: Counter[str] = Counter()
        self.lateral_error, self.heading_error = Extremes(), Extremes()
        self.cross_track_error, self.road_error = Extremes(), Extremes()
        self.self_estimate = SelfEstimateErrors()
        self.tyres = TyreFigures()
        self.estimated_gap_min, self.estimated_gap_max = inf, -inf
        self.held_braking_min = inf
        self.lateral_deviation_max = -1.0
        self._accuracy_max = 0.0
        self.reaction = Reaction()
        self.health: Health | None = None
        self._memory_max = 0
        self._cpu_sum, self._cpu_count = 0.0, 0

    @property
    def poses(self) -> int:
        return self.sent.received

    def add_truth(self, pose: TruePose) -> None:
        self.distance, self.speed = pose.distance_m, pose.speed_mps
        self.truth.add(pose.seq, pose.true_at_ns)
        self.tyres.add(pose)
        if not self.is_lead:
            self.reaction.add_truth(pose)

    def add_error(self, foot: CrossTrack) -> None:
        self.cross_track_error.add(foot.lateral, foot.at_ns)
        self.self_estimate.add_true(foot.at_ns, foot.lateral)

    def add_tracking(self, tracking: Tracking) -> None:
        mode, error = tracking.mode, tracking.lateral_error_m
        self.decisions.add(tracking.seq, tracking.decided_at_ns)
        if mode not in {"path", "straight"}:  # without a trajectory there is no error
            self.self_estimate.add_estimate(tracking.decided_at_ns, error)
        if not self.is_lead:
            self.reaction.add_tracking(tracking)
        self.lateral_error.add(error)
        self.heading_error.add(tracking.heading_error_rad)
        self.mode = mode
        self.modes[mode] += 1
        gap = tracking.estimated_gap_m
        if -inf < gap < self.estimated_gap_min:  # false for NaN: no gap
            self.estimated_gap_min = gap
        if self.estimated_gap_max < gap < inf:
            self.estimated_gap_max = gap
        if isnan(tracking.measured_gap_m):
            held = braking_held(gap, tracking.predecessor_age_s)
            if held < self.held_braking_min:  # noqa: PLR1730 - NaN
                self.held_braking_min = held
        if tracking.lateral_deviation_m > self.lateral_deviation_max:  # noqa: PLR1730 - NaN
            self.lateral_deviation_max = tracking.lateral_deviation_m

    def add_pose(self, pose: GpsPose) -> None:
        self.sent.add(pose.seq, pose.sent_at_ns)
        if pose.position_accuracy_m > self._accuracy_max:  # noqa: PLR1730 - NaN
            self._accuracy_max = pose.position_accuracy_m
        if self._first_sent_at is None:
            self._first_sent_at = pose.sent_at_ns

    @property
    def position_deviation(self) -> float:
        """Largest standard deviation (m) of its position: the receiver's, or its own estimate.

        Infinite if neither is recorded, as in an extract of true poses.
        """
        if not self.poses and self.lateral_deviation_max < 0.0:
            return inf
        return max(self._accuracy_max, self.lateral_deviation_max)

    def add_health(self, health: Health) -> None:
        self.health = health
        self._memory_max = max(self._memory_max, health.memory_bytes)
        if health.seq and not health.final:  # those cover a second, first and last less
            self._cpu_sum += health.cpu_ratio
            self._cpu_count += 1

    def holes(self, span: RunSpan) -> list[RecordHole]:
        """Holes in the record of its poses, up to its end or that of the run.

        A vehicle that became silent without final counters may have failed: no hole. Without a
        schedule of sending only gaps in the numbers are known.
        """
        if self.rate_hz is None:
            return list(self.sent.unscheduled_holes(self.name, span.start_at or 0))
        expected = self.scheduled_poses(span)
        return list(holes_of(self.name, self.sent, self.rate_hz, expected))

    def scheduled_poses(self, span: RunSpan, was_cut_off: bool = False) -> int:
        """Count the poses due until its end or that of the run; 0 if that is unknown.

        A vehicle that was cut off sent until the end of the run.
        """
        if self.rate_hz is None:
            return 0
        if was_cut_off:
            return expected_poses(span.ran_ns, self.rate_hz)
        return self._scheduled(span, self.rate_hz)

    def _scheduled(self, span: RunSpan, rate_hz: float) -> int:
        until = self._ran_until(span)
        return 0 if until is None else expected_poses(until, rate_hz)

    def _ran_until(self, span: RunSpan) -> int | None:
        """Time (ns) up to which its messages are due, None if that is unknown.

        A vehicle without final counters that was silent at the end of a complete run for a short
        time was cut off or the last messages are missing; one that was silent for longer may have
        failed.
        """
        if span.start_at is None or self.health is None or self.ends_early:
            return None
        if not self.health.final:
            is_silent = self._silent_from_s(span) is not None
            return None if is_silent or span.ran_ns < span.planned_ns else span.ran_ns
        until = min(span.ran_ns, self.health.reported_at_ns - span.start_at)
        if until < span.planned_ns:  # stopped early: its last poses were not sent
            until -= SILENT_NS
        return until

    def unseen(self, span: RunSpan) -> list[UnseenSpan]:
        """Times in which nothing is known of it, up to its end or that of the run."""
        start_at = span.start_at or 0
        spans = [
            *self.truth.unseen(self.name, "true pose", start_at),
            *self.decisions.unseen(self.name, "decision", start_at),
        ]
        is_silent = self._silent_from_s(span) is not None
        cut_off = is_silent and self.health is not None and not self.health.final
        until = span.ran_ns if cut_off and not self.ends_early else self._ran_until(span)
        last_s = ((self.truth.last_at or start_at) - start_at) / SECOND
        if until is not None and until / SECOND - last_s > LONGEST_STEP / self._control_rate_hz:
            missing_s = until / SECOND - last_s
            spans.append(
                UnseenSpan(
                    vehicle=self.name,
                    kind="true pose",
                    from_s=last_s,
                    to_s=until / SECOND,
                    missing_s=missing_s,
                )
            )
        return spans

    def true_holes(self, holes: Sequence[RecordHole], span: RunSpan) -> Iterator[RecordHole]:
        """Holes in the record of its true poses outside of `holes`."""
        slack_s = 1.0 / (self.rate_hz or USUAL_RATE_HZ)
        rate_hz = self._control_rate_hz
        is_without_truths = bool(self.poses) and not self.truth.count  # as some logs
        expected = 0 if is_without_truths else self._scheduled(span, rate_hz)
        missing = holes_of(self.name, self.truth, rate_hz, expected, "true pose")
        for hole in missing:
            if not any(known.covers(hole, slack_s) for known in holes):
                yield hole

    @property
    def sent_for_s(self) -> float:
        """Time (s) of sending: by the number of poses, or without a schedule from the first on."""
        if self.rate_hz is not None:
            return self.poses / self.rate_hz
        return self._seconds_from(self._first_sent_at)

    def recorded_for_s(self, start_at: int | None) -> float:
        """Recorded time (s): by the number of poses, or without a schedule from the start (ns)."""
        if self.rate_hz is not None:
            return self.poses / self.rate_hz
        return self._seconds_from(start_at)

    def _seconds_from(self, begun: int | None) -> float:
        return 0.0 if begun is None else max(self.last_at - begun, 0) / SECOND

    def _silent_from_s(self, span: RunSpan) -> float | None:
        """Time (s) after which nothing of it was recorded although the run went on."""
        if span.start_at is None:
            return None
        if not self.last_at:  # nothing of it was ever recorded
            return 0.0 if span.ran_ns >= span.planned_ns else None
        until = max(self.last_at - span.start_at, 0)
        return until / SECOND if span.ran_ns - until > SILENT_NS else None

    def summary(
        self, span: RunSpan, gap: TrueGap | None, seconds: Callable[[int], float]
    ) -> VehicleSummary:
        """List the figures so far.

        `gap` is that to the predecessor; `seconds` converts an instant (ns) to seconds from the
        start of the run.
        """
        health, true, tyres = self.health, self.cross_track_error, self.tyres
        road = self.road_error
        own, estimate = self.lateral_error, self.self_estimate.difference
        if gap is not None and not isfinite(gap.min_m):
            gap = None
        return VehicleSummary(
            name=self.name,
            role="lead" if self.is_lead else "follower",
            poses=self.poses,
            missing_poses=sum([hole.poses for hole in self.holes(span)]),
            silent_from_s=self._silent_from_s(span),
            # Without data an error is None rather than 0.
            lateral_error_m_max=own.largest if own.count else None,
            lateral_error_m_rms=own.rms if own.count else None,
            heading_error_rad_max=self.heading_error.largest if own.count else None,
            cross_track_error_m_max=true.largest if true.count else None,
            cross_track_error_m_rms=true.rms if true.count else None,
            cross_track_error_max_at_s=seconds(true.largest_at) if true.count else None,
            road_error_m_max=road.largest if road.count else None,
            road_error_m_rms=road.rms if road.count else None,
            road_error_max_at_s=seconds(road.largest_at) if road.count else None,
            self_estimate_error_m_max=estimate.largest if estimate.count else None,
            lateral_deviation_m_max=self.lateral_deviation_max
            if self.lateral_deviation_max >= 0.0
            else None,
            true_gap_m_min=gap.min_m if gap else None,
            true_gap_min_at_s=seconds(gap.min_at_ns) if gap else None,
            true_gap_m_max=gap.max_m if gap else None,
            true_gap_max_at_s=seconds(gap.max_at_ns) if gap else None,
            estimated_gap_m_min=self.estimated_gap_min
            if isfinite(self.estimated_gap_min)
            else None,
            estimated_gap_m_max=self.estimated_gap_max
            if isfinite(self.estimated_gap_max)
            else None,
            held_braking_mps2_min=self.held_braking_min
            if isfinite(self.held_braking_min)
            else None,
            distance_m=self.distance,
            lateral_acceleration_mps2_max=tyres.lateral_acceleration if tyres.poses else None,
            front_slip_rad_max=tyres.front_slip if tyres.poses else None,
            rear_slip_rad_max=tyres.rear_slip if tyres.poses else None,
            friction_ratio_max=tyres.friction if tyres.poses else None,
            sliding_s=tyres.sliding / self._control_rate_hz if tyres.poses else None,
            ticks_by_mode=dict(sorted(self.modes.items())),
            reaction=self.reaction.summary,
            ticks=health.ticks if health else 0,
            late_ticks=health.late_ticks if health else 0,
            late_ticks_at_start=health.late_ticks_at_start if health else 0,
            late_ticks_by_network=health.late_ticks_by_network if health else 0,
            lateness_ms_max=health.lateness_ms_max if health else 0.0,
            rejected_messages=health.rejected_messages if health else 0,
            memory_bytes_max=self._memory_max,
            cpu_ratio=self._cpu_sum / self._cpu_count if self._cpu_count else 0.0,
            finished=bool(health and health.final),
        )


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
