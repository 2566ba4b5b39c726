"""Messages that a vehicle sends: its pose for the convoy, everything else for the log."""

from bisect import insort
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import attrgetter
from threading import Lock
from typing import Protocol

from scenarios.definition.changes import change_json
from scenarios.definition.schema.change_tables import AnyChange
from scenarios.definition.schema.plug_ins.point import PlugInError
from scenarios.runs.node.decision_messages import (
    command_message,
    tracking_message,
    trajectory_message,
)
from scenarios.runs.node.sink import Sink
from transport.links.inbox import Inbox
from transport.links.true_poses import TruePoses
from vehicles import messages
from vehicles.car.clock import VehicleClock
from vehicles.car.dynamics import Actuation, Body, TyreUse, rolling_use, tyre_use
from vehicles.car.gnss import Fix, to_message
from vehicles.car.parameters import VehicleParameters
from vehicles.car.path_history import PathHistory
from vehicles.car.tyres import axle_loads
from vehicles.driver.decision import Decision
from vehicles.geometry.geodesy import LocalPlane
from vehicles.geometry.sampled_path import NO_HISTORY
from vehicles.messages import NO_ANNOUNCEMENT, Announcement, Message
from vehicles.schedule import SECOND, Timer, nanoseconds

# ---- Pending changes of one vehicle, by its scenario and by hand


@dataclass(frozen=True, slots=True)
class DueChange:
    """A change that takes effect at the instant `at` (ns), by a scenario or by hand."""

    at: int
    change: AnyChange
    by_hand: bool = False


_at = attrgetter("at")


class PendingChanges:
    """Pending changes of one vehicle, in order of time and then of addition.

    Any thread may add; only the vehicle's thread takes.
    """

    def __init__(self, scheduled_changes: Iterable[DueChange] = ()) -> None:
        self._coming = sorted(scheduled_changes, key=_at)
        self._lock = Lock()

    def add(self, due: DueChange) -> None:
        with self._lock:
            insort(self._coming, due, key=_at)

    @property
    def pending(self) -> tuple[DueChange, ...]:
        with self._lock:
            return tuple(self._coming)

    def take(self, now: int) -> list[DueChange]:
        """Remove and return the changes that are due at the tick at `now` (ns)."""
        if not self._coming or self._coming[0].at > now:  # the usual tick needs no lock
            return []
        with self._lock:
            count = sum([due.at <= now for due in self._coming])
            taken, self._coming = self._coming[:count], self._coming[count:]
        return taken


def scheduled_changes(
    changes: Iterable[AnyChange], start_at: int, concerns: Callable[[AnyChange], bool]
) -> list[DueChange]:
    """Changes of a scenario that concern a vehicle, for a run from `start_at` (ns)."""
    return [
        DueChange(start_at + nanoseconds(change.at_s), change)
        for change in changes
        if concerns(change)
    ]


# ---- Memory, processor time and lateness of a vehicle; in virtual time all of them are zero


@dataclass(frozen=True, slots=True)
class Usage:
    """Resident memory, share of one core since the start, late ticks, and the process's clock.

    Late ticks with neither of the two causes are due to the processor. The offset of the clock from
    the recorder's was removed, up to the uncertainty.
    """

    memory_bytes: int = 0
    cpu_ratio: float = 0.0
    late_ticks: int = 0
    lateness_ms_max: float = 0.0
    clock_offset_ms: float = 0.0
    clock_uncertainty_ms: float = 0.0
    late_ticks_at_start: int = 0
    late_ticks_by_network: int = 0


class Probe(Protocol):
    def read(self) -> Usage: ...


class NoProbe:
    """For virtual time, where a vehicle has no process of its own and no tick is late."""

    def read(self) -> Usage:
        return Usage()


# ---- Outbox


@dataclass(frozen=True, slots=True)
class OutboxState:
    """Next message numbers, ticks, and the instant of the next counters (ns) of an outbox."""

    next_numbers: Mapping[type[Message], int] = field(default_factory=dict)
    ticks: int = 0
    late_ticks: int = 0
    health_at: int | None = None


class Outbox:
    """Builds and numbers the messages of one vehicle and passes them to a sink."""

    def __init__(
        self,
        *,
        vehicle: str,
        sink: Sink,
        plane: LocalPlane,
        parameters: VehicleParameters,
        inbox: Inbox,
        probe: Probe,
        start_at: int,
        clock: VehicleClock | None = None,
        state: OutboxState | None = None,
        target: TruePoses | None = None,
    ) -> None:
        """`probe` measures the process; health is sent once a second from `start_at` (ns) on.

        Measurements are stamped by the vehicle's own `clock`; messages for the log have the true
        time. A `state` continues an earlier outbox. `target` has the true poses that the vehicle's
        gap sensor measures.
        """
        state = state or OutboxState()
        self._vehicle = vehicle
        self._sink, self._send = sink, sink.send
        self._plane = plane
        self._parameters, self._loads = parameters, axle_loads(parameters)
        self._inbox = inbox
        self._target, self._late_targets = target, 0
        self._probe = probe
        self._clock = clock or VehicleClock(start_at)
        # Steady, because not every schedule has a tick at each whole second.
        due_at = start_at if state.health_at is None else state.health_at
        self._health = Timer(SECOND, due_at=due_at, steady=True)
        self._next: Counter[type[Message]] = Counter(state.next_numbers)
        self._ticks = state.ticks
        self._late_ticks = state.late_ticks
        self._mode = ""
        self._commands_are_read = sink.reads(messages.Command)
        self._trajectories_are_read = sink.reads(messages.CompositeTrajectory)

    @property
    def state(self) -> OutboxState:
        return OutboxState(dict(self._next), self._ticks, self._late_ticks, self._health.due_at)

    def publish(
        self,
        now: int,
        body: Body,
        fix: Fix | None,
        decision: Decision,
        path: PathHistory | None = None,
    ) -> None:
        """Send a fix, if any, and the verdicts and the decision of the tick at `now` (ns).

        `path` is the path history up to the fix.
        """
        self._ticks += 1
        if fix is not None:
            self._add_pose(now, body, fix, decision.announcement, path)
        for verdict in self._inbox.verdicts():
            self._add(verdict)
        if decision.fresh:
            self._add_truth(now, body, self._use(body, decision.actuation))
            self._add_decision(now, decision)
        for line in self._inbox.clock_warnings():
            self._add_text(now, line, "alert")
        if self._health.is_due(now):
            self._add_health(now, final=False)
        self._sink.flush()

    def publish_idle(  # noqa: PLR0917 - what a car can send without its software
        self,
        now: int,
        body: Body,
        command: Actuation | None,
        fix: Fix | None = None,
        path: PathHistory | None = None,
        announcement: Announcement = NO_ANNOUNCEMENT,
        *,
        fresh: bool,
    ) -> None:
        """Send a fix, if any, and log a car without its software; `fresh` at instants of control.

        Without a `command` (a replayed car) it is taken to roll.
        """
        self._ticks += 1
        self._mode = ""
        if fix is not None:
            self._add_pose(now, body, fix, announcement, path)
        if fresh:
            if command is None:
                self._add_truth(now, body, rolling_use(body, self._parameters))
            else:
                self._add_truth(now, body, self._use(body, command))
        if self._health.is_due(now):
            self._add_health(now, final=False)
        self._sink.flush()

    def publish_change(self, now: int, due: DueChange, text: str) -> None:
        """Report a change that was carried out at the tick at `now` (ns)."""
        self._add(
            messages.Change(
                vehicle=self._vehicle,
                seq=self._next[messages.Change],
                effective_at_ns=due.at,
                kind=due.change.kind,
                by_hand=due.by_hand,
                table=change_json(due.change),
            )
        )
        self._add_text(now, text)

    def log(self, now: int, text: str, level: messages.Level = "info") -> None:
        """Write a line into the log; sent with the messages of this tick."""
        self._add_text(now, text, level)

    def publish_recorded(self, now: int, recorded: Sequence[Message]) -> None:
        """Send recorded messages, which have their numbers, at the tick at `now` (ns)."""
        self._ticks += 1
        for message in recorded:
            self._add(message)
        if self._health.is_due(now):
            self._add_health(now, final=False)
        self._sink.flush()

    def publish_health(self, now: int, *, final: bool = False) -> None:
        self._add_health(now, final=final)
        self._sink.flush()

    def publish_fault(self, now: int, text: str) -> None:
        """Log why the vehicle failed and send its final counters."""
        self._add_text(now, text, "fatal")
        self.publish_health(now, final=True)

    def _add_text(self, now: int, text: str, level: messages.Level = "info") -> None:
        self._add(
            messages.LogText(
                vehicle=self._vehicle,
                seq=self._next[messages.LogText],
                logged_at_ns=now,
                level=level,
                text=text,
            )
        )

    def _add_health(self, now: int, *, final: bool) -> None:
        usage = self._probe.read()
        for reason, count in self._inbox.rejections():
            self._add_text(now, f"{count} messages refused: {reason}", "warning")
        if usage.late_ticks > self._late_ticks:
            late = usage.late_ticks - self._late_ticks
            worst = usage.lateness_ms_max
            self._add_text(now, f"{late} late ticks, by up to {worst:.1f} ms so far", "warning")
            self._late_ticks = usage.late_ticks
        late_targets, refused_targets = self._count_targets(now)
        waiting = ""
        if final:
            with suppress(PlugInError):  # of a law of the user, which has ended the run
                waiting = self._inbox.waiting(now)
        self._add(
            messages.Health(
                vehicle=self._vehicle,
                seq=self._next[messages.Health],
                reported_at_ns=now,
                ticks=self._ticks,
                late_ticks=usage.late_ticks,
                lateness_ms_max=usage.lateness_ms_max,
                received=self._inbox.delivered,
                dropped=self._inbox.dropped,
                late_messages=self._inbox.late + late_targets,
                rejected_messages=self._inbox.rejected.total() + refused_targets,
                published=sum(self._next.values()),
                memory_bytes=usage.memory_bytes,
                cpu_ratio=usage.cpu_ratio,
                final=final,
                clock_offset_ms=usage.clock_offset_ms,
                clock_uncertainty_ms=usage.clock_uncertainty_ms,
                late_ticks_at_start=usage.late_ticks_at_start,
                late_ticks_by_network=usage.late_ticks_by_network,
                waiting=waiting,
            )
        )

    def _count_targets(self, now: int) -> tuple[int, int]:
        """Number of true poses that were late for the gap sensor, reported, and of refused ones."""
        target = self._target
        if target is None:
            return 0, 0
        if late := target.late - self._late_targets:
            text = f"{late} true poses of {target.vehicle} arrived too late for the gap sensor"
            self._add_text(now, f"{text}: raise gap_sensor.latency_ms", "warning")
            self._late_targets = target.late
        return target.late, target.refused

    def _add_pose(
        self,
        now: int,
        body: Body,
        fix: Fix,
        announcement: Announcement,
        path: PathHistory | None,
    ) -> None:
        stamped_at = self._clock.reading(fix.measured_at)
        if stamped_at != fix.measured_at:  # few clocks are wrong
            fix = replace(fix, measured_at=stamped_at)
        self._add(
            to_message(
                fix,
                self._vehicle,
                self._plane,
                seq=self._next[messages.GpsPose],
                sent_at=now,
                true_position=(body.east, body.north, body.distance),
                announcement=announcement,
                history=NO_HISTORY if path is None else path.deltas(),
            )
        )

    def _use(self, body: Body, command: Actuation) -> TyreUse:
        return tyre_use(body, command.acceleration, self._parameters, self._loads)

    def _add_truth(self, now: int, body: Body, tyres: TyreUse) -> None:
        self._add(
            messages.TruePose(
                vehicle=self._vehicle,
                seq=self._next[messages.TruePose],
                true_at_ns=now,
                east_m=body.east,
                north_m=body.north,
                yaw_rad=body.yaw,
                speed_mps=body.speed,
                lateral_speed_mps=body.lateral_speed,
                yaw_rate_radps=body.yaw_rate,
                steering_rad=body.steering,
                distance_m=body.distance,
                lateral_acceleration_mps2=tyres.lateral_acceleration,
                front_slip_rad=tyres.front_slip,
                rear_slip_rad=tyres.rear_slip,
                friction_ratio=tyres.friction_share,
            )
        )

    def _add_decision(self, now: int, decision: Decision) -> None:
        """Send a decision; messages that nothing reads are counted but not built."""
        name, seq, fit = self._vehicle, self._next[messages.Tracking], decision.fit
        self._add(tracking_message(decision, name, seq, now))
        if self._commands_are_read:
            self._add(command_message(decision, name, seq, now))
        else:
            self._next[messages.Command] += 1
        if fit is not None and self._trajectories_are_read:
            self._add(trajectory_message(decision, fit, name, seq, now))
        elif fit is not None:
            self._next[messages.CompositeTrajectory] += 1
        if decision.mode != self._mode:
            self._mode = decision.mode
            why = f" ({decision.reason})" if decision.reason else ""
            self._add_text(now, f"mode {decision.mode}{why}")
        for line in decision.remarks:
            self._add_text(now, line)

    def _add(self, message: Message) -> None:
        self._next[type(message)] += 1
        self._send(message)
