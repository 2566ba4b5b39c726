"""Figures of a run, gathered message by message: live, in virtual time, or from a log."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, sqrt
from statistics import fmean
from typing import Any

from scenarios.definition.schema.tables import LinkTable
from scenarios.results.summary import LinkSummary, VehicleSummary
from transport.reasons import counts_as_loss
from vehicles.geometry.driven_path import CrossTrackError
from vehicles.messages import GpsPose, Health, LinkVerdict, Message, Tracking, TruePose
from vehicles.schedule import MILLISECOND


@dataclass(slots=True)
class Extremes:
    """Largest magnitude and root mean square of a signal, gathered one value at a time."""

    largest: float = 0.0
    squares: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        """Take one value."""
        if value > self.largest:
            self.largest = value
        elif -value > self.largest:
            self.largest = -value
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
class VehicleFigures:
    """What one vehicle did."""

    poses: int = 0
    last_pose_seq: int = -1
    distance: float = 0.0
    lateral_error: Extremes = field(default_factory=Extremes)
    heading_error: Extremes = field(default_factory=Extremes)
    cross_track_error: Extremes = field(default_factory=Extremes)
    gap_min: float = inf
    modes: Counter[str] = field(default_factory=Counter)
    health: Health | None = None
    memory_max: int = 0
    cpu: list[float] = field(default_factory=list)


class Metrics:
    """Gathers the figures of a run from its messages."""

    def __init__(
        self,
        vehicles: Sequence[str],
        requested: Mapping[tuple[str, str], LinkTable],
        road_yaw: float | None = None,
    ) -> None:
        """Take the vehicles' names, lead first, and what was asked of each (sender, receiver).

        `road_yaw` (rad) is the direction of the road on which the convoy starts.
        """
        self._names = list(vehicles)
        self._requested = requested
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

    def add(self, message: Message) -> None:
        """Take one message; kinds that carry no figure, and strangers, are passed over."""
        figures = self.vehicles.get(message.vehicle)
        take = self._take.get(type(message))
        if figures is not None and take is not None:
            take(figures, message)

    def _add_truth(self, figures: VehicleFigures, pose: TruePose) -> None:
        figures.distance = pose.distance_m
        for foot in self._cross_track_error.add(pose):
            self.vehicles[foot.vehicle].cross_track_error.add(foot.lateral)

    def _add_tracking(self, figures: VehicleFigures, tracking: Tracking) -> None:
        figures.lateral_error.add(tracking.lateral_error_m)
        figures.heading_error.add(tracking.heading_error_rad)
        figures.modes[tracking.mode] += 1
        if -inf < tracking.gap_m < figures.gap_min:  # false for NaN: there is no gap to tell
            figures.gap_min = tracking.gap_m

    def _add_pose(self, figures: VehicleFigures, pose: GpsPose) -> None:
        figures.poses += 1
        figures.last_pose_seq = max(pose.seq, figures.last_pose_seq)

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

    def vehicle_summaries(self) -> tuple[VehicleSummary, ...]:
        """Figures per vehicle, the lead first."""
        return tuple(self._vehicle(name) for name in self._names)

    def link_summaries(self) -> tuple[LinkSummary, ...]:
        """Figures per directed link, by receiver and then sender from the lead on."""
        return tuple(self._link(link) for link in sorted(self._requested, key=self._order))

    def _order(self, link: tuple[str, str]) -> tuple[int, int]:
        sender, receiver = link
        return self._names.index(receiver), self._names.index(sender)

    def _vehicle(self, name: str) -> VehicleSummary:
        figures = self.vehicles[name]
        health, true = figures.health, figures.cross_track_error
        is_lead = name == self._names[0]
        return VehicleSummary(
            name=name,
            role="lead" if is_lead else "follower",
            poses=figures.poses,
            missing_poses=max(figures.last_pose_seq + 1 - figures.poses, 0),
            lateral_error_m_max=figures.lateral_error.largest,
            lateral_error_m_rms=figures.lateral_error.rms,
            heading_error_rad_max=figures.heading_error.largest,
            # Where nothing could be compared there is no error, rather than none to speak of.
            cross_track_error_m_max=true.largest if true.count else None,
            cross_track_error_m_rms=true.rms if true.count else None,
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
