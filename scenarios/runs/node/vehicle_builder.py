"""Builds one vehicle from its part of the scenario."""

from collections.abc import Hashable, Iterator, Sequence
from functools import partial
from hashlib import blake2b
from itertools import takewhile
from math import cos, sin

import numpy as np
from numpy.random import Generator

from scenarios.definition.changes import EffectsOf, concerns
from scenarios.definition.channel.build import (
    content_stage,
    link_effects,
    link_stages,
    vehicles_between,
)
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.change_tables import AnyChange
from scenarios.definition.schema.plug_ins.point import begin
from scenarios.definition.schema.plug_ins.points import RECEIVER_ERROR, SENDING
from scenarios.definition.vehicle_setup import VehicleSetup
from scenarios.runs.node.driver_builder import DriverBuilder
from scenarios.runs.node.node import AnyNode, Node, SoftwareHandover
from scenarios.runs.node.outbox import Outbox, PendingChanges, Probe, scheduled_changes
from scenarios.runs.node.phases import (
    Car,
    ChangedLinks,
    ChangeExecutor,
    ChangingLink,
    Down,
    Driver,
    Driving,
    HumanDriving,
    Software,
    VehicleContext,
    VehiclePhase,
)
from scenarios.runs.node.recorded_vehicle import (
    RecordedNode,
    ReplayedNode,
    read_replayed_vehicle,
)
from scenarios.runs.node.sink import Sink
from transport.clock import Tick, ticks
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.link_law import VehiclesBetween
from transport.links.link import Link, PoseGate
from transport.links.true_poses import TruePoses
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import GnssReceiver
from vehicles.car.gnss_error_terms import ReceiverContext, Streams
from vehicles.car.imu import ExactSensor, InertialSensor
from vehicles.car.path_history import PathHistory
from vehicles.car.sending_rules import ReactiveControl, Sender, SendingContext
from vehicles.car.sensors import GapSensor
from vehicles.driver.speed import ProfileSpeed
from vehicles.geometry.geodesy import LocalPlane
from vehicles.schedule import MILLISECOND, SECOND, Cadence, instants

# ---- Builds the GNSS receiver and the sender of a node


RECEIVER_STREAM = 2
"""Key of these random streams; that of an inertial sensor is 1."""
SHARED_STREAM = 2**32 - 1
"""Place in the convoy for random streams that all vehicles share."""


def make_receiver(scenario: Scenario, setup: VehicleSetup, start_at: int) -> GnssReceiver:
    """Make the receiver of a vehicle in a run that starts at `start_at` (ns).

    White noise and each other error have random streams of their own, so that none affects another.
    """
    random = np.random.Generator(np.random.PCG64([scenario.seed, setup.place]))
    start = ReceiverContext(
        start_at,
        distance_behind_lead=sum(scenario.route.spacings[: setup.place + 1]),
        own_streams=_streams(scenario.seed, setup.place),
        shared_streams=_streams(scenario.seed, SHARED_STREAM),
    )
    return GnssReceiver(setup.gnss, start, random, partial(begin, RECEIVER_ERROR))


def make_sender(scenario: Scenario, setup: VehicleSetup, start_at: int) -> Sender:
    rule = setup.sending
    control = None if rule.dcc is None else ReactiveControl(rule.dcc, start_at)
    path = PathHistory(LocalPlane(scenario.origin), rule.path_history, rule.path_history_points)
    trigger = begin(SENDING, rule, _sending_start(scenario, setup, start_at))
    return Sender(trigger, control, path)


def extra_instants(
    scenario: Scenario, setup: VehicleSetup, start_at: int, end_at: int
) -> Sequence[Iterator[int]]:
    """Instants (ns) of sending and of late fixes, which need ticks of their own.

    Randomly drawn intervals have none: their messages wait for the next tick.
    """
    schedules: list[Iterator[int]] = []
    if setup.gnss.latency:
        schedules.append(instants(start_at + setup.gnss.latency, end_at, setup.gnss.rate))
    of_sending = setup.sending.instants(_sending_start(scenario, setup, start_at), end_at)
    return schedules if of_sending is None else [*schedules, of_sending]


def _sending_start(scenario: Scenario, setup: VehicleSetup, start_at: int) -> SendingContext:
    return SendingContext(start_at, _streams(scenario.seed, setup.place))


def _streams(seed: int, place: int) -> Streams:
    return partial(_stream, seed, place)  # no closure: a receiver can be pickled


def _stream(seed: int, place: int, purpose: str) -> Generator:
    word = int.from_bytes(blake2b(purpose.encode(), digest_size=4).digest(), "little")
    return np.random.Generator(np.random.PCG64([seed, place, RECEIVER_STREAM, word]))


# ---- Vehicle builder


IMU_STREAM = 1
"""Key of the random stream of an inertial sensor."""
GAP_STREAM = 3
"""Key of the random stream of a gap sensor."""


class VehicleBuilder:
    """Builds one vehicle of a scenario as a node for a start instant."""

    def __init__(self, scenario: Scenario, name: str) -> None:
        """Read the recorded messages of a replayed vehicle.

        Raises ScenarioError if `scenario` has no vehicle called `name`, and LogError if its
        recorded messages cannot be read.
        """
        self.name = name
        self._scenario = scenario
        self._setup = scenario.vehicle(name)
        self._plane = LocalPlane(scenario.origin)
        self._route = scenario.route
        self._drivers = DriverBuilder(scenario, name)
        self._changed = ChangedLinks(scenario.vehicle_names, ())
        self.duration_ns = round(scenario.duration_s * SECOND)
        self.control_rate_hz = scenario.control_rate_hz
        rates_hz = [scenario.control_rate_hz, self._setup.gnss.rate]
        if not self._setup.has_exact_state:
            rates_hz.append(self._setup.imu_rate_hz)  # usually that of control
        self.rates_hz = tuple(dict.fromkeys(rates_hz))
        self.target: TruePoses | None = None
        self._recorded = read_replayed_vehicle(scenario.tables.replay, name)

    @property
    def scenario(self) -> Scenario:
        return self._scenario

    @property
    def schedule(self) -> Hashable:
        """Key of the schedule: vehicles with equal keys have equal ticks."""
        if self._recorded:
            return self.name
        extra = extra_instants(self._scenario, self._setup, 0, 0)
        return (self.rates_hz, self.name) if extra else self.rates_hz

    def ticks(self, start_at: int) -> Iterator[Tick]:
        """Schedule of the vehicle from `start_at` (ns) to the end of the run."""
        end_at = start_at + self.duration_ns
        if self._recorded:
            instants = self._recorded.instants(start_at)
            recorded = takewhile(lambda at: at < end_at, instants)
            return ticks(start_at, end_at, self.control_rate_hz, more=[recorded])
        extra = extra_instants(self._scenario, self._setup, start_at, end_at)
        return ticks(start_at, end_at, *self.rates_hz, more=extra)

    @property
    def stagger_ns(self) -> int:
        """Delay (ns) of the vehicle's ticks after their instants, on the wall clock.

        Vehicles take turns, from the lead back, to spread the load: over a control period where
        each receives only from vehicles before it, so that none loses time for its messages; over
        half of it where the lead receives its followers, at latencies of a period or more; else all
        begin at once.
        """
        names, period = self._scenario.vehicle_names, SECOND / self.control_rate_hz
        from_behind = [
            link.latency_ms * MILLISECOND
            for (sender, to), link in self._scenario.links.items()
            if names.index(sender) > names.index(to)
        ]
        share = 1.0 if not from_behind else 0.5 if min(from_behind) >= period else 0.0
        return round(share * self._setup.place * period / len(names))

    def node(
        self, start_at: int, sink: Sink, probe: Probe, handover: SoftwareHandover | None = None
    ) -> AnyNode:
        """Build a node that starts at `start_at` (ns) and sends its messages to `sink`.

        A `handover` continues a vehicle whose process was restarted. Afterwards `target` takes the
        true poses that the vehicle's gap sensor measures, if it has one.
        """
        setup, drive = self._setup, self._scenario.replays.get(self.name)
        coming = scheduled_changes(self._scenario.tables.change, start_at, self.concerns)
        by_hand = handover.changed_links if handover else ()
        self._changed = ChangedLinks(self._scenario.vehicle_names, coming, by_hand)
        clock = self._scenario.clock(self.name, start_at)
        inbox = Inbox(
            self.name,
            self.links(start_at),
            start_at=start_at,
            before=handover.inbox if handover else None,
        )
        if setup.gap_sensor is not None and setup.predecessor is not None:
            self.target = TruePoses(setup.predecessor)
        outbox = Outbox(
            vehicle=self.name,
            sink=sink,
            plane=self._plane,
            parameters=setup.parameters,
            inbox=inbox,
            probe=probe,
            start_at=start_at,
            clock=clock,
            state=handover.outbox if handover else None,
            target=self.target,
        )
        if self._recorded:
            messages = self._recorded.messages(start_at)
            return RecordedNode(messages=messages, inbox=inbox, outbox=outbox)
        control = Cadence(start_at, self.control_rate_hz)
        if drive is not None:
            return ReplayedNode(
                drive=drive,
                start_at=start_at,
                wheelbase=setup.parameters.wheelbase,
                control=control,
                gnss=make_receiver(self._scenario, setup, start_at),
                sender=make_sender(self._scenario, setup, start_at),
                inbox=inbox,
                outbox=outbox,
                pending_changes=PendingChanges(coming),
            )
        context = VehicleContext(
            start_at=start_at,
            car=handover.car if handover else self._car(start_at),
            clock=clock,
            control=control,
            plan=handover.plan if handover else self._route.plan,
            inbox=inbox,
            outbox=outbox,
            factory=self,
            target=self.target,
            draw=self._drivers.draw,
        )
        if handover is not None:
            changes = ChangeExecutor(PendingChanges(handover.pending), self._changed)
            return Node(context, changes, Down(context, handover.until))
        changes = ChangeExecutor(PendingChanges(coming), self._changed)
        return Node(context, changes, self._first_phase(context))

    def _first_phase(self, context: VehicleContext) -> VehiclePhase:
        if self._scenario.joins_late(self.name):
            return HumanDriving(context, context.start_at, None)
        start_at = context.start_at
        return Driving(context, self._software(start_at, context, set_off=False))

    def concerns(self, change: AnyChange) -> bool:
        return concerns(change, self.name, self._scenario.tables, self._scenario.links)

    def _car(self, start_at: int) -> Car:
        return Car(
            body=self._body(),
            parameters=self._setup.parameters,
            gnss=make_receiver(self._scenario, self._setup, start_at),
            imu=self._imu(start_at),
            command=Actuation(0.0, 0.0),
            gap_sensor=self._gap_sensor(start_at),
        )

    def links(self, start_at: int) -> list[IncomingLink]:
        """Links from all its sources, in a run from `start_at` (ns)."""
        is_replayed = self.name in self._scenario.tables.replayed
        senders = () if is_replayed else self._setup.senders
        links = [self._incoming(sender, start_at) for sender in senders]
        self._changed.adopt(self._changing(incoming, start_at) for incoming in links)
        return links

    def software(self, now: int, context: VehicleContext) -> Software:
        """Software that starts at `now` (ns) and knows only the car's position.

        A lead that stood still follows its speed profile by station rather than by time.
        """
        return self._software(now, context, set_off=self._setup.predecessor is None)

    def _software(self, now: int, context: VehicleContext, *, set_off: bool) -> Software:
        driver, law = self._drivers.software(now, context)
        return Software(
            driver=driver,
            sender=make_sender(self._scenario, self._setup, context.start_at),
            law=law,
            alone=set_off,
        )

    def human(self, context: VehicleContext) -> tuple[Driver, ProfileSpeed]:
        return self._drivers.human(context)

    def station(self, body: Body) -> float:
        """Station (m) on the road of a car by its distance driven."""
        return self._drivers.station(body)

    def _changing(self, incoming: IncomingLink, start_at: int) -> ChangingLink:
        sender = incoming.link.sender
        requested = self._scenario.links[sender, self.name]
        return ChangingLink(incoming.link, requested, self._effects_of(sender, start_at))

    def _incoming(self, sender: str, start_at: int) -> IncomingLink:
        scenario = self._scenario
        requested, setup = scenario.links[sender, self.name], scenario.vehicle(sender)
        rate_hz = setup.highest_rate_hz
        effects = self._effects_of(sender, start_at)(requested, ())
        link = Link(effects, scenario.seed, sender, self.name, link_stages(requested))
        gate = PoseGate(
            sender=sender,
            start_at=start_at,
            rate_hz=rate_hz,
            plane=self._plane,
            clock_error_ns=scenario.clock_error_ns(sender),
        )
        return IncomingLink(link, gate, content_stage(requested.content, link, gate))

    def _effects_of(self, sender: str, start_at: int) -> EffectsOf:
        """Builder of the effects of the link from `sender` for any settings."""
        rate_hz = self._scenario.vehicle(sender).highest_rate_hz
        setting = self._scenario.link_setting(sender, self.name, start_at)
        between = partial(self._between, sender)
        return lambda requested, extra: link_effects(requested, rate_hz, setting, between, extra)

    def _between(self, sender: str) -> VehiclesBetween:
        """Vehicles between `sender` and this one."""
        ahead = self._scenario.vehicle(sender).place
        return vehicles_between(self._route, ahead, self._setup.place)

    def _body(self) -> Body:
        """The car at its start: on the path behind its predecessor, with its offsets."""
        setup = self._setup
        place = self._route.path.at(self._route.start_station(setup.place))
        offset = setup.lateral_offset_m
        return Body(
            east=place.east - offset * sin(place.yaw),
            north=place.north + offset * cos(place.yaw),
            yaw=place.yaw + setup.heading_offset_rad,
            speed=self._route.plan.profile.at(0.0)[0],
        )

    def _imu(self, start_at: int) -> InertialSensor | ExactSensor:
        if self._setup.has_exact_state:
            return ExactSensor()
        # A separate stream keeps the receiver's noise independent of this sensor.
        random = self._stream(IMU_STREAM)
        return InertialSensor(self._setup.imu, self._setup.imu_rate_hz, start_at, random)

    def _gap_sensor(self, start_at: int) -> GapSensor | None:
        setup = self._setup
        if setup.gap_sensor is None or setup.predecessor is None:
            return None
        target = self._scenario.vehicle(setup.predecessor).parameters
        random = self._stream(GAP_STREAM)
        control = Cadence(start_at, self.control_rate_hz)
        return GapSensor(setup.gap_sensor, setup.parameters, target, control, random)

    def _stream(self, key: int) -> np.random.Generator:
        words = [self._scenario.seed, self._setup.place, key]
        return np.random.Generator(np.random.PCG64(words))
