"""Phases of a vehicle: driving, stalled, restarting, or driven by a human.

In every phase the car moves, its sensors measure and its true poses are logged. Poses are sent only
while its software drives.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from scenarios.definition.road.set_speed import SpeedPlan
from scenarios.runs.node.outbox import Outbox
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.effect import Position
from transport.links.true_poses import TruePoses
from vehicles.car.clock_error import VehicleClock
from vehicles.car.dynamics import Actuation, Body, CarMotion, DriveTrain
from vehicles.car.gnss import Fix, GnssReceiver
from vehicles.car.parameters import VehicleParameters
from vehicles.car.sending.sender import Sender
from vehicles.car.sensors.gap_sensor import GapMeasurement, GapSensor
from vehicles.car.sensors.imu import ExactSensor, InertialSensor, Motion
from vehicles.driver.decision import Driver
from vehicles.driver.degradation.settings import DegradationSettings
from vehicles.driver.speed import ProfileSpeed
from vehicles.schedule import SECOND, Cadence

BRAKING = DegradationSettings().firm.deceleration
"""Deceleration (m/s²) of a car whose software is down: Autoware's emergency stop, without jerk."""


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

    `target` has the true poses that the gap sensor measures.
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
        return HumanDriving(self.context, now)

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
        decision = self.software.driver.step(now, fix, motion, received, gap)
        sender = self.software.sender
        sent = sender.send(now, fix, decision.dead_reckoned, on_path=decision.keeps_to_path)
        context.outbox.publish(now, car.body, sent, decision, sender.path)
        return decision.actuation

    def replan(self, now: int) -> None:
        self.context.apply_speed_plan(now, self.software.law, alone=self.software.alone)

    def stalled(self, until: int) -> VehiclePhase:
        return Stalled(self, until)


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
    """A human drives by sight: nothing received is used, and nothing is sent.

    The human keeps to the road by the lead's steering law with the true position. The speed is the
    convoy's planned one, lowered before bends; other vehicles are ignored.
    """

    def __init__(self, context: VehicleContext, now: int) -> None:
        super().__init__(context)
        self._human, self._law = context.factory.human(context)
        self.replan(now)

    def step(self, now: int) -> Actuation:
        context, car = self.context, self.context.car
        context.inbox.discard(now, car.position)
        return context.idle(now, self._human.step(now, None, car.body, ()).actuation)

    def replan(self, now: int) -> None:
        self.context.apply_speed_plan(now, self._law, alone=True)

    def crashed(self, until: int) -> None:
        """No effect: the software does not run."""

    def left(self, now: int) -> None:
        """No effect: it has left already."""

    def joined(self, now: int) -> VehiclePhase:
        return Driving.restarted(self.context, now)
