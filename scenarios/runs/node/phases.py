"""Phases of a vehicle: driving, stalled, restarting, or driven by a human.

In every phase the car moves, its sensors measure and its true poses are logged. Poses are sent only
while its software drives.
"""

from bisect import insort
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Protocol

from scenarios.definition.changes import (
    LINK_CHANGES,
    EffectsOf,
    LinkChange,
    Made,
    course,
    describe_change,
    links_of,
)
from scenarios.definition.road.lead_speed import SpeedPlan
from scenarios.definition.schema.change_tables import (
    AnyChange,
    CrashTable,
    FixChangeTable,
    JoinTable,
    LeaveTable,
    SpeedChangeTable,
    StallTable,
)
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.definition.schema.plug_ins.point import InstantDraw
from scenarios.runs.node.outbox import DueChange, Outbox, PendingChanges
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.link_law import Position
from transport.links.link import Link
from transport.links.true_poses import TruePoses
from vehicles.car.clock import VehicleClock
from vehicles.car.dynamics import Actuation, Body, CarMotion, DriveTrain
from vehicles.car.gnss import Fix, GnssReceiver
from vehicles.car.gnss_error_terms import NO_END
from vehicles.car.imu import ExactSensor, InertialSensor, Motion
from vehicles.car.parameters import VehicleParameters
from vehicles.car.sending_rules import Sender
from vehicles.car.sensors import GapMeasurement, GapSensor
from vehicles.driver.follower import Follower
from vehicles.driver.leader import Leader
from vehicles.driver.speed import ProfileSpeed
from vehicles.schedule import SECOND, Cadence, nanoseconds

# ---- Changes of the incoming links of one vehicle

Driver = Leader | Follower
"""Driver of a car: the controller of Fig. 1, together with the drive."""


@dataclass(slots=True)
class ChangingLink:
    """One link with its requested settings and its changes by instant (ns), in order of time."""

    link: Link
    requested: LinkTable
    effects_of: EffectsOf
    changes: list[tuple[int, LinkChange]] = field(default_factory=list)
    made: Made = field(default_factory=dict)

    def change(self, at: int, change: LinkChange) -> None:
        """Change the link from the instant `at` (ns) on; earlier effects stay."""
        insort(self.changes, (at, change), key=itemgetter(0))
        before = [changed for changed in self.link.changes if changed.from_at < at]
        after = course(self.changes, self.requested, self.effects_of, since=at, made=self.made)
        self.link.changes = (*before, *after)


class ChangedLinks:
    """Changes of the links to one vehicle of a convoy of `names`.

    A link knows the `scheduled` changes beforehand; those by hand are added when they are due.
    Changes belong to the channel: they outlive the vehicle's software, which builds its links
    again.
    """

    def __init__(
        self,
        names: Sequence[str],
        scheduled: Iterable[DueChange],
        by_hand: Iterable[DueChange] = (),
    ) -> None:
        self._names = names
        self._links: dict[tuple[str, str], ChangingLink] = {}
        self._scheduled = list(scheduled)
        self._by_hand = list(by_hand)

    @property
    def by_hand(self) -> tuple[DueChange, ...]:
        return tuple(self._by_hand)

    def adopt(self, links: Iterable[ChangingLink]) -> None:
        """Replace the links and apply all changes so far to the new ones."""
        self._links = {
            (changing.link.sender, changing.link.receiver): changing for changing in links
        }
        for due in (*self._scheduled, *self._by_hand):
            self._change(due)

    def carry_out(self, due: DueChange) -> str:
        """Carry out a change of links; returns a line for the log, empty for other changes."""
        if not isinstance(due.change, LINK_CHANGES):
            return ""
        if due.by_hand:
            self._by_hand.append(due)
            self._change(due)
        about = links_of(due.change, self._names, self._links)
        links = ", ".join(f"{sender} → {receiver}" for sender, receiver in about)
        return f"{links}: {describe_change(due.change)}{', by hand' if due.by_hand else ''}"

    def _change(self, due: DueChange) -> None:
        if isinstance(due.change, LINK_CHANGES):
            for pair in links_of(due.change, self._names, self._links):
                self._links[pair].change(due.at, due.change)


# ---- Phases


BRAKING = 2.5
"""Deceleration (m/s²) of a car whose software is down: Autoware's emergency stop, without jerk."""
LEAVES_FOR = SECOND
"""Time (ns) for which a vehicle that has left announces it: single messages may be lost."""


@dataclass(slots=True, kw_only=True)
class Car:
    """Car, sensors and last command: independent of the software."""

    body: Body
    parameters: VehicleParameters
    gnss: GnssReceiver
    imu: InertialSensor | ExactSensor
    command: Actuation
    gap_sensor: GapSensor | None = None
    _motion: CarMotion = field(init=False)
    _drive: DriveTrain = field(init=False)

    def __post_init__(self) -> None:
        self._motion = CarMotion(self.parameters)
        self._drive = DriveTrain(self.parameters.drive_lag)

    def measure(self, now: int) -> tuple[Fix | None, Motion | Body | None]:
        """Fix and motion measured at `now` (ns); call it at every tick."""
        return self.gnss.measure(self.body, now), self.imu.measure(self.body, now)

    def advance(self, command: Actuation, span: float) -> None:
        """Move by `span` (s) with `command`."""
        self.command = command
        self.body = self._motion.advance(self.body, self._drive.act(command, self.body, span), span)

    @property
    def position(self) -> Position:
        body = self.body
        return Position(body.east, body.north, body.distance)


@dataclass(slots=True, kw_only=True)
class Software:
    """Driver and sender; `law` is set if the driver follows a speed profile.

    `alone`: the profile is the vehicle's own, planned from where it starts.
    """

    driver: Driver
    sender: Sender
    law: ProfileSpeed | None
    alone: bool


class VehicleFactory(Protocol):
    """Builds the parts of a vehicle that a restart of its software needs."""

    def station(self, body: Body) -> float:
        """Station (m) of the car on the road."""
        ...

    def links(self, start_at: int) -> Iterable[IncomingLink]:
        """Links without received messages, of a run from `start_at` (ns)."""
        ...

    def software(self, now: int, context: "VehicleContext") -> Software:
        """Software that starts at `now` (ns) and knows only its position."""
        ...

    def human(self, context: "VehicleContext") -> tuple[Driver, ProfileSpeed]: ...


@dataclass(slots=True, kw_only=True)
class VehicleContext:
    """Parts shared by all phases of a vehicle; instants (ns) count from `start_at`.

    `target` has the true poses that the gap sensor measures, `draw` the random numbers of classes.
    """

    start_at: int
    car: Car
    clock: VehicleClock
    control: Cadence
    plan: SpeedPlan
    inbox: Inbox
    outbox: Outbox
    factory: VehicleFactory
    target: TruePoses | None
    draw: InstantDraw

    def apply_speed_plan(self, now: int, law: ProfileSpeed | None, *, alone: bool) -> None:
        """Apply the planned speed to `law`; `alone`, from the position of the car."""
        if law is None:
            return
        if not alone:
            law.follow(self.plan.profile)
            return
        seconds, body = (now - self.start_at) / SECOND, self.car.body
        law.follow(self.plan.setting_off(seconds, self.factory.station(body), body.speed))

    def measure_gap(self, now: int) -> GapMeasurement | None:
        """Gap measurement that is available now; call it at every tick."""
        sensor, target = self.car.gap_sensor, self.target
        if sensor is None or target is None:
            return None
        return sensor.measure(self.car.body, now, target.newest_at)

    def idle(self, now: int, command: Actuation) -> Actuation:
        """Keep `command` at `now` (ns) while the software does nothing."""
        self.car.measure(now)
        self.measure_gap(now)
        self.outbox.publish_idle(now, self.car.body, command, fresh=self.control.due(now))
        return command


class VehiclePhase:
    """Base of the phases. A change leads to another phase or has no effect (None)."""

    def __init__(self, context: VehicleContext) -> None:
        self.context = context

    def step(self, now: int) -> Actuation:
        """Act at the tick at `now` (ns); returns the command until the next one."""
        raise NotImplementedError

    def at(self, now: int) -> "VehiclePhase":  # noqa: ARG002
        """Return the phase at `now` (ns): this one, unless it is over."""
        return self

    def replan(self, now: int) -> None:
        """Apply a changed plan of the convoy's speed."""

    def stalled(self, until: int) -> "VehiclePhase | None":  # noqa: ARG002
        """Phase whose control does not run before `until` (ns)."""
        return None

    def crashed(self, until: int) -> "VehiclePhase | None":
        """Phase whose software restarts at `until` (ns)."""
        return Down(self.context, until)

    def left(self, now: int) -> "VehiclePhase | None":
        return HumanDriving(self.context, now, None)

    def joined(self, now: int) -> "VehiclePhase | None":  # noqa: ARG002
        return None


class Driving(VehiclePhase):
    """The software drives."""

    def __init__(self, context: VehicleContext, software: Software) -> None:
        super().__init__(context)
        self.software = software
        self.has_begun = False

    @classmethod
    def restarted(cls, context: VehicleContext, now: int) -> "Driving":
        """Begin at `now` (ns) without memory."""
        context.inbox.restart(context.factory.links(context.start_at), now)
        driving = cls(context, context.factory.software(now, context))
        driving.replan(now)
        return driving

    def step(self, now: int) -> Actuation:
        self.has_begun = True
        context, car = self.context, self.context.car
        received = context.clock.restamped(now, context.inbox.take(now, car.position))
        fix, motion = car.measure(now)
        gap = context.measure_gap(now)
        context.draw.now = now
        decision = self.software.driver.step(now, fix, motion, received, gap)
        sender = self.software.sender
        sent = sender.send(now, fix, decision.dead_reckoned, on_path=decision.keeps_to_path)
        context.outbox.publish(now, car.body, sent, decision, sender.path)
        return decision.actuation

    def replan(self, now: int) -> None:
        self.context.apply_speed_plan(now, self.software.law, alone=self.software.alone)

    def stalled(self, until: int) -> VehiclePhase:
        return Stalled(self, until)

    def left(self, now: int) -> VehiclePhase:
        return HumanDriving(self.context, now, self.software.sender)


class Stalled(VehiclePhase):
    """Control does not run: the car keeps its command, and messages wait."""

    def __init__(self, driving: Driving, until: int) -> None:
        super().__init__(driving.context)
        self._driving = driving
        self._until = until

    def step(self, now: int) -> Actuation:
        self.context.inbox.skip(now, self.context.car.position)
        return self.context.idle(now, self.context.car.command)

    def at(self, now: int) -> VehiclePhase:
        """Return the phase at `now` (ns): the software continues, or begins."""
        if now < self._until:
            return self
        driving = self._driving
        return driving if driving.has_begun else Driving.restarted(self.context, now)

    def replan(self, now: int) -> None:
        self._driving.replan(now)

    def stalled(self, until: int) -> VehiclePhase:
        return Stalled(self._driving, max(until, self._until))


class Down(VehiclePhase):
    """The software is lost: the car brakes to a standstill with its steering kept."""

    def __init__(self, context: VehicleContext, until: int) -> None:
        super().__init__(context)
        self.until = until

    def step(self, now: int) -> Actuation:
        """Brake; messages sent by now are lost."""
        car = self.context.car
        self.context.inbox.discard(now, car.position)
        return self.context.idle(now, Actuation(car.command.steering, -BRAKING))

    def at(self, now: int) -> VehiclePhase:
        if now < self.until:
            return self
        self.context.outbox.log(now, "its software has restarted")
        return Driving.restarted(self.context, now)

    def crashed(self, until: int) -> None:
        """No effect: the software does not run."""


class HumanDriving(VehiclePhase):
    """A human drives by sight: nothing received is used; what is sent announces the departure.

    The human keeps to the road by the lead's steering law with the true position. The speed is the
    convoy's planned one, lowered before bends; other vehicles are ignored.
    """

    def __init__(self, context: VehicleContext, now: int, sender: Sender | None) -> None:
        """`sender` is that of the software, which announces for `LEAVES_FOR` that it has left."""
        super().__init__(context)
        self._human, self._law = context.factory.human(context)
        self._sender, self._until = sender, now + LEAVES_FOR
        self.replan(now)

    def step(self, now: int) -> Actuation:
        context, car = self.context, self.context.car
        context.inbox.discard(now, car.position)
        fix, _ = car.measure(now)
        context.measure_gap(now)
        self.context.draw.now = now
        decision, sent, path = self._human.step(now, None, car.body, ()), None, None
        if self._sender is not None and now < self._until:
            decision.leaving = True
            sent, path = self._sender.send(now, fix), self._sender.path
        fresh, command = context.control.due(now), decision.actuation
        context.outbox.publish_idle(
            now, car.body, command, sent, path, decision.announcement, fresh=fresh
        )
        return command

    def replan(self, now: int) -> None:
        self.context.apply_speed_plan(now, self._law, alone=True)

    def crashed(self, until: int) -> None:
        """No effect: the software does not run."""

    def left(self, now: int) -> None:
        """No effect: it has left already."""

    def joined(self, now: int) -> VehiclePhase:
        return Driving.restarted(self.context, now)


# ---- Carries out and reports changes of one vehicle while it runs


WORDS = {
    "stall": "its control stalls",
    "crash": "its process crashes",
    "leave": "it leaves the convoy, a human takes over",
    "join": "it joins the convoy",
    "gnss": "its receiver has another fix",
    "speed": "the set speed changes",
}
"""Log text by kind of change."""


class CrashedError(Exception):
    """The process of a vehicle has crashed for good, as requested."""


class ChangeExecutor:
    """Carries out the changes of a vehicle with its own car and software."""

    def __init__(self, pending_changes: PendingChanges, links: ChangedLinks) -> None:
        self.pending_changes = pending_changes
        self.links = links

    def apply(self, now: int, phase: VehiclePhase) -> VehiclePhase:
        """Carry out what is due at the tick at `now` (ns); returns the phase of this tick.

        Raises CrashedError if the vehicle does not return.
        """
        for due in self.pending_changes.take(now):
            phase = self._apply(due, now, phase)
        return phase.at(now)

    def _apply(self, due: DueChange, now: int, phase: VehiclePhase) -> VehiclePhase:
        context = phase.context
        if isinstance(due.change, LINK_CHANGES):
            context.outbox.publish_change(now, due, self.links.carry_out(due))
            return phase
        following = _phase_after(due, now, phase)
        if following is None:
            context.outbox.log(now, f"{_described(due.change)}: has no effect now", "warning")
            return phase
        context.outbox.publish_change(now, due, _described(due.change))
        match due.change:
            case CrashTable(for_s=None):
                raise CrashedError("its process has crashed, as requested")
            case FixChangeTable():
                change_fix(context.car.gnss, due.at, due.change)
            case SpeedChangeTable():
                after_s = (due.at - context.start_at) / SECOND
                context.plan = context.plan.changed(after_s, due.change)
                following.replan(now)
        return following


def _phase_after(due: DueChange, now: int, phase: VehiclePhase) -> VehiclePhase | None:
    """Phase after a change; None if the change has no effect."""
    match due.change:
        case StallTable(for_s=for_s):
            return phase.stalled(due.at + nanoseconds(for_s))
        case CrashTable(for_s=float(for_s)):
            return phase.crashed(due.at + nanoseconds(for_s))
        case LeaveTable():
            return phase.left(now)
        case JoinTable():
            return phase.joined(now)
        case _:
            return phase


def change_fix(gnss: GnssReceiver, at: int, change: FixChangeTable) -> None:
    """Force a fix from the instant `at` (ns) on, or restore the receiver's own law."""
    state = None if change.fix == "auto" else change.fix
    until = NO_END if change.for_s is None else at + nanoseconds(change.for_s)
    gnss.force(state, at, until)


def change_receiver(
    pending_changes: PendingChanges, gnss: GnssReceiver, outbox: Outbox, now: int
) -> None:
    """Carry out what is due at `now` (ns) for a vehicle that can only change its receiver."""
    for due in pending_changes.take(now):
        match due.change:
            case FixChangeTable():
                outbox.publish_change(now, due, _described(due.change))
                change_fix(gnss, due.at, due.change)
            case _:
                text = f"{_described(due.change)}: has no effect on a recorded drive"
                outbox.log(now, text, "warning")


def _described(change: AnyChange) -> str:
    named = {"kind", "at_s", "vehicle"}
    figures = change.model_dump(exclude=named, exclude_none=True)
    rest = ", ".join(f"{key} = {value}" for key, value in figures.items())
    words = WORDS.get(change.kind, change.kind)
    return f"{words} ({rest})" if rest else words
