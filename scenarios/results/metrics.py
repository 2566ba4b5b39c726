"""Gathers the figures of a run: live, in virtual time, or from a log."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from operator import attrgetter
from typing import Any

from pydantic import ValidationError

from scenarios.definition.changes import VEHICLE_CHANGES, is_changed
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.change_tables import CrashTable
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.account import CUT_OFF_AFTER_NS, Link, LinkAccount, absence_lines
from scenarios.results.deadlines import Deadlines
from scenarios.results.encounters import BodySize, Episode
from scenarios.results.holes import RecordHole, UnseenSpan
from scenarios.results.link_figures import LinkFigures
from scenarios.results.link_summary import LinkSummary
from scenarios.results.run_event import OF_DECISIONS, EventLog
from scenarios.results.stream import FigureStream, RoadError
from scenarios.results.string_figures import StringNorms, string_figures
from scenarios.results.summary import ChangeLog, RunChange
from scenarios.results.vehicle_figures import (
    USUAL_CONTROL_RATE_HZ,
    USUAL_RATE_HZ,
    RunSpan,
    VehicleFigures,
    VehicleSummary,
)
from transport.topics import TOPIC_OF
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.car.tyres import linear_range
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import (
    Change,
    Command,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    RunStart,
    Tracking,
    TruePose,
)
from vehicles.schedule import SECOND, nanoseconds

MOST_WARNINGS = 50
"""Warnings about impossible time stamps in the summary."""


class Metrics:
    def __init__(
        self,
        vehicles: Sequence[str],
        requested: Mapping[tuple[str, str], LinkTable],
        road_yaw: float | None = None,
        *,
        stream: FigureStream | None = None,
        rates_hz: Mapping[str, float | None] | None = None,
        control_rate_hz: float = USUAL_CONTROL_RATE_HZ,
        duration_ns: int = 0,
        linear_slips: Mapping[str, tuple[float, float]] | None = None,
        deadlines: Deadlines | None = None,
        norms: StringNorms | None = None,
        continues_without_failed: bool = False,
    ) -> None:
        """Take the vehicles' names, lead first, and the settings of each (sender, receiver).

        `road_yaw` (rad) is the direction of the road at the start. `rates_hz` are the rates of the
        vehicles' poses, None for a vehicle without a schedule; `duration_ns` is the planned
        duration. `linear_slips` are the slip angles (rad) of front and rear axle up to which the
        tyres of each vehicle are linear; `deadlines` are what followers have to do by an instant.
        Without a `stream` of figures, one with usual cars and thresholds is made; `norms` know the
        gap that followers keep.
        """
        self._names = list(vehicles)
        self._lead = self._names[0]
        self._duration_ns = duration_ns
        self.control_rate_hz = control_rate_hz
        self.stream = stream or FigureStream(
            dict.fromkeys(vehicles, BodySize.of(LINCOLN_MKZ)), road_yaw=road_yaw
        )
        self.events = EventLog(self.stream.seconds, self._seen_before)
        self._norms = norms or StringNorms(vehicles)
        self.stream.on_foot(self._norms.add_error)
        self.stream.on_error(self._add_error)
        self.stream.on_road_error(self._add_road_error)
        self.stream.on_event(self.events.add)
        self.warnings: list[str] = []
        self.out_of_linear: dict[str, str] = {}
        self._reported_linear = 0
        self._linear_slips = linear_slips or dict.fromkeys(vehicles, linear_range(LINCOLN_MKZ))
        self.vehicles = {
            name: VehicleFigures(
                name,
                is_lead=name == self._lead,
                rate_hz=(rates_hz or {}).get(name, USUAL_RATE_HZ),
                control_rate_hz=control_rate_hz,
            )
            for name in vehicles
        }
        self._links = LinkFigures(self._names, requested, control_rate_hz)
        self.links = self._links.tallies
        self.deadlines = deadlines or Deadlines()
        self._changes = ChangeLog()
        self._has_deadlines = bool(self.deadlines)
        self._continues = continues_without_failed
        self._recorded_at = 0
        takes: Mapping[type[Message], Callable[[VehicleFigures, Any, int], None]] = {
            TruePose: self._add_truth,
            Tracking: self._add_tracking,
            GpsPose: self._add_pose,
            LinkVerdict: self._add_verdict,
            Health: self._add_health,
            Change: self._add_change,
            Command: self._add_command,
        }
        self._takes = {
            kind: (take, attrgetter(TOPIC_OF[kind].instant)) for kind, take in takes.items()
        }
        self.kinds: frozenset[type[Message]] = frozenset((*self._takes, LogText, RunStart))

    @classmethod
    def of(cls, scenario: Scenario) -> "Metrics":
        return cls(
            scenario.vehicle_names,
            scenario.links,
            scenario.route.start_yaw,
            stream=FigureStream.of(scenario),
            rates_hz={name: _steady_rate_hz(scenario, name) for name in scenario.vehicle_names},
            control_rate_hz=scenario.control_rate_hz,
            duration_ns=nanoseconds(scenario.duration_s),
            linear_slips={
                name: linear_range(scenario.vehicle(name).parameters)
                for name in scenario.vehicle_names
            },
            deadlines=Deadlines(scenario.tables.limits, scenario.lead),
            norms=StringNorms.of(scenario),
            continues_without_failed=scenario.continues_without_failed,
        )

    @property
    def start_at(self) -> int | None:
        """Start of the run (ns), once known."""
        return self.stream.start_at

    @property
    def topics(self) -> list[str]:
        return [TOPIC_OF[kind].name for kind in (*self._takes, LogText, RunStart)]

    def listen(self, at: int, message: Message) -> None:
        """Take one message; those without figures and of unknown vehicles are ignored."""
        if (handler := self._takes.get(type(message))) is not None:
            figures = self.vehicles.get(message.vehicle)
            if figures is not None:
                take, instant_of = handler
                self._recorded_at = at
                valid_at: int = instant_of(message)
                if valid_at > figures.last_at:  # noqa: PLR1730 - twice as fast as max
                    figures.last_at = valid_at
                take(figures, message, valid_at)
        elif isinstance(message, LogText):
            self._add_text(message)
        elif isinstance(message, RunStart):
            self.stream.listen(at, message)
            self.deadlines.begin(message.start_at_ns)
            self._links.begin(message.start_at_ns)

    def _add_text(self, text: LogText) -> None:
        if text.ends_vehicle and text.vehicle in self.vehicles:
            self.vehicles[text.vehicle].ends_early = True
        if text.doubts_figures and len(self.warnings) < MOST_WARNINGS:
            self.warnings.append(f"{text.vehicle}: {text.text}")

    def _add_truth(self, figures: VehicleFigures, pose: TruePose, _at: int) -> None:
        figures.add_truth(pose)
        self._norms.add_truth(pose)
        front, rear = self._linear_slips[pose.vehicle]
        tyres = figures.tyres
        if tyres.front_slip > front or tyres.rear_slip > rear:
            self._note_slips(pose, front, rear)
        self.stream.add_truth(pose)

    def _note_slips(self, pose: TruePose, front: float, rear: float) -> None:
        if pose.vehicle in self.out_of_linear:
            return
        after_s = self.stream.seconds(pose.true_at_ns)
        self.out_of_linear[pose.vehicle] = (
            f"{pose.vehicle}: tyres beyond their linear range of {front:.4f} rad of slip in front, "
            f"{rear:.4f} rad at the rear, from {after_s:.2f} s after the start"
        )

    def take_new(self) -> list[str]:
        """Lines about tyres outside of their linear range since the last call."""
        if self._reported_linear == len(self.out_of_linear):
            return []
        new = list(self.out_of_linear.values())[self._reported_linear :]
        self._reported_linear = len(self.out_of_linear)
        return new

    def _add_error(self, foot: CrossTrack) -> None:
        self.vehicles[foot.vehicle].add_error(foot)
        if self._has_deadlines:
            self.deadlines.add_error(foot.vehicle, foot.at_ns, foot.lateral)

    def _add_road_error(self, error: RoadError) -> None:
        self.vehicles[error.vehicle].road_error.add(error.lateral, error.at_ns)

    def _add_tracking(self, figures: VehicleFigures, tracking: Tracking, at: int) -> None:
        figures.add_tracking(tracking)
        self._links.add_decision(tracking)
        self.stream.add_tracking(tracking)
        if not figures.is_lead:
            self._links.add_tracking(tracking, at)
            if self._has_deadlines:
                self.deadlines.add_tracking(tracking)

    def _add_pose(self, figures: VehicleFigures, pose: GpsPose, _at: int) -> None:
        figures.add_pose(pose)
        self._links.sent[pose.vehicle].add(pose.seq, pose.sent_at_ns, self._recorded_at)

    def _add_health(self, figures: VehicleFigures, health: Health, _at: int) -> None:
        figures.add_health(health)

    def _add_command(self, _figures: VehicleFigures, command: Command, _at: int) -> None:
        self.stream.add_command(command)

    def _add_change(self, figures: VehicleFigures, change: Change, _at: int) -> None:
        self.stream.add_change(change)
        if change.kind in VEHICLE_CHANGES:
            figures.rate_hz = None
        figures.ends_early |= _crashes_for_good(change)
        self._links.add_change(change)
        self._changes.add(change)

    def _add_verdict(self, _receiver: VehicleFigures, verdict: LinkVerdict, _at: int) -> None:
        self._links.add_verdict(verdict)

    def finish(self) -> None:
        """Close events that are still open."""
        self.stream.finish()

    def vehicle_summaries(self, ran_ns: int = 0) -> tuple[VehicleSummary, ...]:
        span, gaps, seconds = self._span(ran_ns), self.stream.gaps, self.stream.seconds
        own, overrides = self.stream.own, self.stream.overrides.of
        deviations = {name: row.position_deviation for name, row in self.vehicles.items()}
        string = string_figures(self._norms.norms, deviations)
        return tuple(
            replace(
                figures.summary(span, gaps.get(name), seconds),
                own_figures=own.values(name),
                overridden_ratio=overrides[name].ratio if name in overrides else None,
                overrides=overrides[name].ratios if name in overrides else {},
                string=string[name],
            )
            for name, figures in self.vehicles.items()
        )

    def holes(self, ran_ns: int = 0) -> tuple[RecordHole, ...]:
        """Missing poses of a run of `ran_ns`, in order of time."""
        missing = [
            hole
            for figures in self.vehicles.values()
            for holes in [figures.holes(self._span(ran_ns))]
            for hole in (*holes, *figures.true_holes(holes, self._span(ran_ns)))
        ]
        return tuple(sorted(missing, key=lambda hole: hole.from_s))

    def unseen(self, ran_ns: int = 0) -> tuple[UnseenSpan, ...]:
        """Times of a run of `ran_ns` in which nothing is known of a vehicle."""
        span = self._span(ran_ns)
        return tuple(time for figures in self.vehicles.values() for time in figures.unseen(span))

    def _seen_before(self, episode: Episode) -> int | None:
        """Instant (ns) before the hole in which an event began, None if its beginning was seen."""
        *_, follower = episode.vehicles
        if episode.kind in OF_DECISIONS:
            series = [self.vehicles[follower].decisions]
        else:
            lead = [self._lead] if episode.kind == "lane_departure" else []
            series = [self.vehicles[name].truth for name in (*episode.vehicles, *lead)]
        start_at = self.start_at or 0
        seen = [numbers.seen_before(episode.at_ns, start_at) for numbers in series]
        return min([at for at in seen if at is not None], default=None)

    def _span(self, ran_ns: int) -> RunSpan:
        return RunSpan(self.start_at, ran_ns, self._duration_ns)

    def accounts(self, ran_ns: int = 0) -> dict[Link, LinkAccount]:
        """Account of the messages of each link in a run of `ran_ns`."""
        span = self._span(ran_ns)
        figures = self.vehicles.items()
        end_at = max([vehicle.last_at for _, vehicle in figures])
        cut_off = [name for name, vehicle in figures if self._was_cut_off(vehicle, end_at)]
        return self._links.accounts(
            {name: vehicle.scheduled_poses(span, name in cut_off) for name, vehicle in figures},
            {name: vehicle.health for name, vehicle in figures},
            cut_off=cut_off,
            start_at=self.start_at,
            end_at=end_at,
        )

    def _was_cut_off(self, vehicle: VehicleFigures, end_at: int) -> bool:
        """Whether a vehicle was out of reach at the end (ns) of the record.

        In a convoy that continues without failed vehicles, a silent one may have failed. A vehicle
        whose last poses came late was out of reach, too, if its records lag.
        """
        health = vehicle.health
        is_physical = any(poses.is_physical for poses in self._links.sent.values())
        if self._continues or self.start_at is None or vehicle.ends_early or not is_physical:
            return False
        if health is not None and health.final:
            return False
        if end_at - max(vehicle.last_at, self.start_at) > CUT_OFF_AFTER_NS:
            return True
        known_until = max(vehicle.truth.last_at or 0, vehicle.decisions.last_at or 0)
        return self._links.sent[vehicle.name].end_late and end_at - known_until > SECOND

    def link_summaries(self, ran_ns: int = 0) -> tuple[LinkSummary, ...]:
        last_at = {name: figures.last_at for name, figures in self.vehicles.items()}
        return self._links.summaries(self.accounts(ran_ns), last_at)

    def changes(self) -> tuple[RunChange, ...]:
        return self._changes.changes(self.stream.seconds)

    def channel_warnings(self, ran_ns: int = 0) -> Iterator[str]:
        """Yield lines on messages that did not arrive and on deviations from the requests."""
        accounts = self.accounts(ran_ns)
        yield from self._links.away_lines(self.stream.seconds)
        yield from absence_lines(accounts, self.stream.seconds)
        yield from self._links.request_deviations(accounts)

    def contradictions(self, ran_ns: int = 0) -> list[str]:
        """Lines on links whose messages are not accounted for."""
        return [link.problem for link in self.accounts(ran_ns).values() if link.problem]


def _crashes_for_good(change: Change) -> bool:
    with suppress(ValidationError):  # messages from the bus may be malformed
        if change.kind == "crash":
            return CrashTable.model_validate_json(change.table).for_s is None
    return False


def _steady_rate_hz(scenario: Scenario, name: str) -> float | None:
    """Pose rate of a vehicle that sends at every instant of measuring, else None."""
    setup = scenario.vehicle(name)
    if is_changed(scenario.tables.change, name) or name in scenario.tables.repeats_messages:
        return None
    return setup.gnss.rate if setup.sends_every_instant else None
