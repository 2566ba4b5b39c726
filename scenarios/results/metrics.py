"""Figures of a run, gathered message by message: live, in virtual time, or from a log."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from statistics import fmean
from typing import Any

from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.tables import LinkTable
from scenarios.results.bodies import BodySize
from scenarios.results.events import EventDetector, detector_of
from scenarios.results.holes import RecordedNumbers, RecordHole, expected_poses, holes_of
from scenarios.results.summary import LinkSummary, VehicleSummary
from transport.reasons import counts_as_loss
from transport.topics import valid_at
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.geometry.driven_path import MOST_WAITING, CrossTrack, CrossTrackError
from vehicles.messages import GpsPose, Health, LinkVerdict, Message, RunStart, Tracking, TruePose
from vehicles.schedule import MILLISECOND, SECOND, nanoseconds

USUAL_RATE_HZ = 20.0
SILENT_NS = SECOND
"""A vehicle of which nothing was heard for so long before the end was not there any more: what is
on its way when a run is stopped takes less."""


@dataclass(slots=True)
class Extremes:
    """Largest magnitude and root mean square of a signal, gathered one value at a time."""

    largest: float = 0.0
    largest_at: int = 0
    squares: float = 0.0
    count: int = 0

    def add(self, value: float, at: int = 0) -> None:
        """Take one value, and its instant (ns) where that is asked for."""
        if value > self.largest:
            self.largest, self.largest_at = value, at
        elif -value > self.largest:
            self.largest, self.largest_at = -value, at
        self.squares += value * value
        self.count += 1

    @property
    def rms(self) -> float:
        """Root mean square, 0 without values."""
        return sqrt(self.squares / self.count) if self.count else 0.0


@dataclass(slots=True)
class LinkFigures:
    """What one directed link did."""

    heard: int = 0
    late: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    latency_ns_sum: int = 0
    latency_ns_max: int = 0


@dataclass(slots=True)
class BelievedErrors:
    """Lateral errors as a vehicle believes them beside the true ones, at equal instants."""

    off: Extremes = field(default_factory=Extremes)
    believed: dict[int, float] = field(default_factory=dict)
    true: dict[int, float] = field(default_factory=dict)

    def add_believed(self, at: int, error: float) -> None:
        """Take what the vehicle believes at instant `at` (ns)."""
        if at in self.true:
            self.off.add(error - self.true.pop(at), at)
        else:
            self._keep(self.believed, at, error)

    def add_true(self, at: int, error: float) -> None:
        """Take the true error at instant `at` (ns)."""
        if at in self.believed:
            self.off.add(self.believed.pop(at) - error, at)
        else:
            self._keep(self.true, at, error)

    def _keep(self, waiting: dict[int, float], at: int, error: float) -> None:
        waiting[at] = error
        if len(waiting) > MOST_WAITING:
            del waiting[next(iter(waiting))]


@dataclass(slots=True)
class VehicleFigures:
    """What one vehicle did."""

    numbers: RecordedNumbers = field(default_factory=RecordedNumbers)
    last_at: int = 0
    distance: float = 0.0
    lateral_error: Extremes = field(default_factory=Extremes)
    heading_error: Extremes = field(default_factory=Extremes)
    cross_track_error: Extremes = field(default_factory=Extremes)
    belief: BelievedErrors = field(default_factory=BelievedErrors)
    gap_min: float = inf
    modes: Counter[str] = field(default_factory=Counter)
    health: Health | None = None
    memory_max: int = 0
    cpu: list[float] = field(default_factory=list)

    @property
    def poses(self) -> int:
        """GPS poses recorded."""
        return self.numbers.count


class Metrics:
    """Gathers the figures of a run from its messages."""

    def __init__(
        self,
        vehicles: Sequence[str],
        requested: Mapping[tuple[str, str], LinkTable],
        road_yaw: float | None = None,
        *,
        events: EventDetector | None = None,
        rates_hz: Mapping[str, float] | None = None,
        duration_ns: int = 0,
    ) -> None:
        """Take the vehicles' names, lead first, and what was asked of each (sender, receiver).

        `road_yaw` (rad) is the direction of the road on which the convoy starts; `rates_hz` are
        those of the receivers, `duration_ns` is as planned. Without a detector of events, usual
        cars and thresholds.
        """
        self._names = list(vehicles)
        self._requested = requested
        self._rates_hz = rates_hz or {}
        self._duration_ns = duration_ns
        self._start_at: int | None = None
        self.events = events or EventDetector(
            dict.fromkeys(vehicles, BodySize.of(LINCOLN_MKZ)), road_yaw=road_yaw
        )
        self.vehicles = {name: VehicleFigures() for name in vehicles}
        self.links: defaultdict[tuple[str, str], LinkFigures] = defaultdict(LinkFigures)
        self._cross_track_error = CrossTrackError(self._names[0], road_yaw)
        self._take: Mapping[type[Message], Callable[[VehicleFigures, Any], None]] = {
            TruePose: self._add_truth,
            Tracking: self._add_tracking,
            GpsPose: self._add_pose,
            LinkVerdict: self._add_verdict,
            Health: self._add_health,
        }

    @classmethod
    def of(cls, scenario: Scenario) -> "Metrics":
        """Figures of a run of `scenario`."""
        return cls(
            scenario.vehicle_names,
            scenario.links,
            scenario.route.start_yaw,
            events=detector_of(scenario),
            rates_hz={name: scenario.vehicle(name).gnss.rate_hz for name in scenario.vehicle_names},
            duration_ns=nanoseconds(scenario.duration_s),
        )

    def add(self, message: Message) -> None:
        """Take one message; kinds that carry no figure, and strangers, are passed over."""
        figures = self.vehicles.get(message.vehicle)
        take = self._take.get(type(message))
        if figures is not None and take is not None:
            figures.last_at = max(figures.last_at, valid_at(message))
            take(figures, message)
        elif isinstance(message, RunStart):
            self._start_at = message.start_at_ns
            self.events.begin(message.start_at_ns)

    def _add_truth(self, figures: VehicleFigures, pose: TruePose) -> None:
        figures.distance = pose.distance_m
        for foot in self._cross_track_error.add(pose):
            self._add_foot(self.vehicles[foot.vehicle], foot)
        self.events.add_truth(pose)

    def _add_foot(self, figures: VehicleFigures, foot: CrossTrack) -> None:
        figures.cross_track_error.add(foot.lateral, foot.at_ns)
        figures.belief.add_true(foot.at_ns, foot.lateral)

    def _add_tracking(self, figures: VehicleFigures, tracking: Tracking) -> None:
        if tracking.mode not in {"path", "straight"}:  # it has nothing to be off from
            figures.belief.add_believed(tracking.decided_at_ns, tracking.lateral_error_m)
        if tracking.vehicle != self._names[0]:
            self.events.add_tracking(tracking)
        figures.lateral_error.add(tracking.lateral_error_m)
        figures.heading_error.add(tracking.heading_error_rad)
        figures.modes[tracking.mode] += 1
        if -inf < tracking.gap_m < figures.gap_min:  # false for NaN: there is no gap to tell
            figures.gap_min = tracking.gap_m

    def _add_pose(self, figures: VehicleFigures, pose: GpsPose) -> None:
        figures.numbers.add(pose.seq)

    def _add_health(self, figures: VehicleFigures, health: Health) -> None:
        figures.health = health
        figures.memory_max = max(figures.memory_max, health.memory_bytes)
        if health.seq and not health.final:  # those cover a second, first and last less
            figures.cpu.append(health.cpu_ratio)

    def _add_verdict(self, _receiver: VehicleFigures, verdict: LinkVerdict) -> None:
        link = self.links[verdict.sender, verdict.vehicle]
        if verdict.outcome == "dropped":
            link.dropped[verdict.reason] += 1
            return
        link.heard += 1
        link.late += verdict.late
        latency = (verdict.heard_at_ns if verdict.late else verdict.visible_at_ns) - (
            verdict.measured_at_ns
        )
        link.latency_ns_sum += latency
        link.latency_ns_max = max(link.latency_ns_max, latency)

    def vehicle_summaries(self, ran_ns: int = 0) -> tuple[VehicleSummary, ...]:
        """Figures per vehicle, the lead first, of a run of `ran_ns`."""
        return tuple(self._vehicle(name, ran_ns) for name in self._names)

    def holes(self, ran_ns: int = 0) -> tuple[RecordHole, ...]:
        """What was not recorded of a run of `ran_ns`, in order of time."""
        found = [hole for name in self._names for hole in self._holes(name, ran_ns)]
        return tuple(sorted(found, key=lambda hole: hole.from_s))

    def _holes(self, name: str, ran_ns: int) -> Iterator[RecordHole]:
        """Holes of one vehicle, up to the end of the run or until it said that it had ended.

        One that fell silent without a word is not a hole: it may have died.
        """
        figures = self.vehicles[name]
        rate_hz = self._rates_hz.get(name, USUAL_RATE_HZ)
        expected = 0
        if self._start_at is not None and figures.health and figures.health.final:
            until = min(ran_ns, figures.health.reported_at_ns - self._start_at)
            if until < self._duration_ns:  # stopped: its last poses were not sent any more
                until -= SILENT_NS
            expected = expected_poses(until, rate_hz)
        return holes_of(name, figures.numbers, rate_hz, expected)

    def _silent_from(self, figures: VehicleFigures, ran_ns: int) -> float | None:
        """Time (s) after which nothing was heard of a vehicle though the run went on."""
        if self._start_at is None:
            return None
        until = max(figures.last_at - self._start_at, 0)
        return until / SECOND if ran_ns - until > SILENT_NS else None

    def link_summaries(self) -> tuple[LinkSummary, ...]:
        """Figures per directed link, by receiver and then sender from the lead on."""
        return tuple(self._link(link) for link in sorted(self._requested, key=self._order))

    def _order(self, link: tuple[str, str]) -> tuple[int, int]:
        sender, receiver = link
        return self._names.index(receiver), self._names.index(sender)

    def _vehicle(self, name: str, ran_ns: int) -> VehicleSummary:
        figures = self.vehicles[name]
        health, true = figures.health, figures.cross_track_error
        is_lead = name == self._names[0]
        gap, seconds = self.events.encounters.gaps.get(name), self.events.seconds
        known = gap is not None and isfinite(gap.min_m)
        return VehicleSummary(
            name=name,
            role="lead" if is_lead else "follower",
            poses=figures.poses,
            missing_poses=sum(hole.poses for hole in self._holes(name, ran_ns)),
            silent_from_s=self._silent_from(figures, ran_ns),
            lateral_error_m_max=figures.lateral_error.largest,
            lateral_error_m_rms=figures.lateral_error.rms,
            heading_error_rad_max=figures.heading_error.largest,
            # Where nothing could be compared there is no error, rather than none to speak of.
            cross_track_error_m_max=true.largest if true.count else None,
            cross_track_error_m_rms=true.rms if true.count else None,
            cross_track_error_max_at_s=seconds(true.largest_at) if true.count else None,
            believed_minus_true_error_m_max=figures.belief.off.largest
            if figures.belief.off.count
            else None,
            true_gap_m_min=gap.min_m if gap and known else None,
            true_gap_min_at_s=seconds(gap.min_at_ns) if gap and known else None,
            gap_m_min=figures.gap_min if isfinite(figures.gap_min) else None,
            distance_m=figures.distance,
            ticks_by_mode=dict(sorted(figures.modes.items())),
            ticks=health.ticks if health else 0,
            late_ticks=health.late_ticks if health else 0,
            lateness_ms_max=health.lateness_ms_max if health else 0.0,
            rejected_messages=health.rejected_messages if health else 0,
            memory_bytes_max=figures.memory_max,
            cpu_ratio=fmean(figures.cpu) if figures.cpu else 0.0,
            finished=bool(health and health.final),
        )

    def _link(self, link: tuple[str, str]) -> LinkSummary:
        sender, receiver = link
        figures = self.links[link]
        lost = sum(count for word, count in figures.dropped.items() if counts_as_loss(word))
        return LinkSummary(
            sender=sender,
            receiver=receiver,
            requested=self._requested[link],
            sent=self.vehicles[sender].poses,
            judged=figures.heard + figures.dropped.total(),
            heard=figures.heard,
            dropped=dict(sorted(figures.dropped.items())),
            # What a link's rate holds back is not sent on it, so it cannot be lost.
            loss_ratio=lost / (figures.heard + lost) if lost else 0.0,
            late=figures.late,
            latency_ms_mean=figures.latency_ns_sum / figures.heard / MILLISECOND
            if figures.heard
            else 0.0,
            latency_ms_max=figures.latency_ns_max / MILLISECOND,
        )
