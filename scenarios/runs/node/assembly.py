"""Builds one vehicle from its part of the scenario."""

from collections.abc import Hashable, Iterator
from functools import partial
from math import cos, sin

import numpy as np

from scenarios.definition.changing.concerned import concerns
from scenarios.definition.changing.links import EffectsOf
from scenarios.definition.channel.build import link_effects
from scenarios.definition.channel.content import content_stage
from scenarios.definition.channel.delay import link_stages
from scenarios.definition.channel.radio import vehicles_between
from scenarios.definition.receivers import assumed_deviation
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.changes import AnyChange
from scenarios.definition.sending import even_rate_hz, highest_rate_hz
from scenarios.runs.node.agenda import Agenda, scheduled
from scenarios.runs.node.changed_links import ChangedLinks, ChangingLink
from scenarios.runs.node.node import Node
from scenarios.runs.node.outbox import Outbox
from scenarios.runs.node.probe import Probe
from scenarios.runs.node.replayed import ReplayedNode
from scenarios.runs.node.signals import instants_besides, make_receiver, make_sender
from scenarios.runs.node.sink import Sink
from transport.clock import Tick, ticks
from transport.links.gate import PoseGate
from transport.links.inbox import Inbox, IncomingLink
from transport.links.laws.radio.obstruction import VehiclesBetween
from transport.links.link import Link
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import ExactSensor, InertialSensor
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Driver
from vehicles.driver.ego.late_fixes import LatePoseEstimator
from vehicles.driver.ego.own_state import KnownState, OwnState
from vehicles.driver.ego.pose_estimator import PoseEstimator
from vehicles.driver.ego.slip_estimator import Assuming, LoadWatch, SlipEstimator
from vehicles.driver.follower import Follower
from vehicles.driver.leader import Leader
from vehicles.driver.speed import GapKeeping, ProfileSpeed, SpeedLaw
from vehicles.driver.steering import LateralController, load_controller
from vehicles.geometry.geodesy import LocalPlane
from vehicles.preview.trajectory import FitSettings
from vehicles.schedule import MILLISECOND, SECOND, Cadence

INERTIAL = 1
"""Tells the random stream of a vehicle's inertial sensor from that of its receiver."""


class VehicleBuilder:
    """Builds one vehicle of a scenario as a node, once the start instant is known."""

    def __init__(self, scenario: Scenario, name: str) -> None:
        """Raises ScenarioError if `scenario` has no vehicle called `name`."""
        self.name = name
        self._scenario = scenario
        self._setup = scenario.vehicle(name)
        self._plane = LocalPlane(scenario.origin)
        self._route = scenario.route
        self.duration_ns = round(scenario.duration_s * SECOND)
        self.control_rate_hz = scenario.control_rate_hz
        rates_hz = [scenario.control_rate_hz, self._setup.gnss.rate_hz]
        if not self._setup.knows_itself:
            rates_hz.append(self._setup.imu_rate_hz)  # usually that of control
        self.rates_hz = tuple(dict.fromkeys(rates_hz))

    @property
    def scenario(self) -> Scenario:
        """The scenario of which the vehicle is one."""
        return self._scenario

    @property
    def schedule(self) -> Hashable:
        """Vehicles for which this is equal have equal ticks."""
        besides = instants_besides(self._scenario, self._setup, 0, 0)
        return (self.rates_hz, self.name) if besides else self.rates_hz

    def ticks(self, start_at: int) -> Iterator[Tick]:
        """The vehicle's schedule from `start_at` (ns) to the end of the run."""
        end_at = start_at + self.duration_ns
        besides = instants_besides(self._scenario, self._setup, start_at, end_at)
        return ticks(start_at, end_at, *self.rates_hz, besides=besides)

    def node(self, start_at: int, sink: Sink, probe: Probe) -> Node | ReplayedNode:
        """The vehicle as a node that starts at `start_at` (ns) and sends its messages to `sink`."""
        setup, drive = self._setup, self._scenario.replays.get(self.name)
        senders = () if drive else setup.senders
        links = [self._incoming(sender, start_at) for sender in senders]
        inbox = Inbox(self.name, links, start_at=start_at)
        coming = scheduled(self._scenario.tables.change, start_at, self._concerns)
        changed = ChangedLinks(self._scenario.vehicle_names, coming)
        changed.adopt(self._changing_links(inbox, start_at))
        outbox = Outbox(
            vehicle=self.name,
            sink=sink,
            plane=self._plane,
            parameters=setup.parameters,
            inbox=inbox,
            probe=probe,
            start_at=start_at,
        )
        if drive is not None:
            return ReplayedNode(
                drive=drive,
                start_at=start_at,
                wheelbase=setup.parameters.wheelbase,
                control=Cadence(start_at, self.control_rate_hz),
                gnss=make_receiver(self._scenario, setup, start_at),
                sender=make_sender(self._scenario, setup, start_at),
                inbox=inbox,
                outbox=outbox,
                agenda=Agenda(coming),
            )
        return Node(
            body=self._body(),
            parameters=setup.parameters,
            gnss=make_receiver(self._scenario, setup, start_at),
            imu=self._imu(start_at),
            driver=self._driver(start_at),
            sender=make_sender(self._scenario, setup, start_at),
            inbox=inbox,
            outbox=outbox,
            agenda=Agenda(coming),
            links=changed,
        )

    def _concerns(self, change: AnyChange) -> bool:
        """Whether this vehicle carries a change out."""
        return concerns(change, self.name, self._scenario.tables, self._scenario.links)

    def _changing_links(self, inbox: Inbox, start_at: int) -> list[ChangingLink]:
        """The incoming links, which can be changed."""
        return [
            ChangingLink(
                one.link,
                self._scenario.links[sender, self.name],
                self._effects_of(sender, start_at),
            )
            for sender, one in inbox.links.items()
        ]

    def _incoming(self, sender: str, start_at: int) -> IncomingLink:
        """The link from `sender`, and the gate that its poses pass."""
        scenario = self._scenario
        asked, setup = scenario.links[sender, self.name], scenario.vehicle(sender)
        rate_hz = highest_rate_hz(setup.sending, setup.gnss)
        effects = self._effects_of(sender, start_at)(asked, ())
        link = Link(effects, scenario.seed, sender, self.name, link_stages(asked))
        gate = PoseGate(sender=sender, start_at=start_at, rate_hz=rate_hz, plane=self._plane)
        return IncomingLink(link, gate, content_stage(asked.content, link, gate))

    def _effects_of(self, sender: str, start_at: int) -> EffectsOf:
        """What makes the effects of the link from `sender`, as it is or as it is changed."""
        setup = self._scenario.vehicle(sender)
        rate_hz = highest_rate_hz(setup.sending, setup.gnss)
        even_hz = even_rate_hz(setup.sending, setup.gnss) or rate_hz
        setting = self._scenario.link_setting(sender, self.name, start_at)
        between = partial(self._between, sender)
        return lambda asked, besides: link_effects(asked, even_hz, setting, between, besides)

    def _between(self, sender: str) -> VehiclesBetween:
        """Who drives between `sender` and this vehicle."""
        ahead = self._scenario.vehicle(sender).place
        return vehicles_between(self._route, ahead, self._setup.place)

    def _body(self) -> Body:
        """The car at its start: on the path its gap behind the one ahead, with its offsets."""
        setup = self._setup
        place = self._route.path.at(self._route.start_station(setup.place))
        aside = setup.lateral_offset_m
        return Body(
            east=place.east - aside * sin(place.yaw),
            north=place.north + aside * cos(place.yaw),
            yaw=place.yaw + setup.heading_offset_rad,
            speed=self._route.profile.at(0.0)[0],
        )

    def _imu(self, start_at: int) -> InertialSensor | ExactSensor:
        if self._setup.knows_itself:
            return ExactSensor()
        # A stream apart from the receiver's, whose noise is the same with and without this sensor.
        words = [self._scenario.seed, self._setup.place, INERTIAL]
        random = np.random.Generator(np.random.PCG64(words))
        return InertialSensor(self._setup.imu_noise, self._setup.imu_rate_hz, start_at, random)

    def _own_state(self, start_at: int) -> OwnState:
        """What tells the car where it is; one whose first fix may come late knows where it starts.

        Fixes count by the accuracy that they state where errors are more than white noise.
        """
        setup = self._setup
        if setup.knows_itself:
            return KnownState()
        gnss = setup.gnss
        estimator = PoseEstimator(
            setup.assumed_parameters,
            setup.gnss_noise,
            setup.imu_noise,
            setup.imu_rate_hz,
            by_accuracy=not gnss.is_plain,
        )
        if gnss.is_punctual:
            return estimator
        body = self._body()
        place = body.east, body.north, body.yaw
        estimator.correct(Fix(0, start_at, *place, body.speed, body.yaw_rate))
        if not gnss.latency_ms:
            return estimator
        return LatePoseEstimator(estimator, round(gnss.latency_ms * MILLISECOND))

    def _driver(self, start_at: int) -> Driver:
        setup = self._setup
        control = Cadence(start_at, self.control_rate_hz)
        own_state = self._own_state(start_at)
        controller = self._controller()
        load = self._load_watch(own_state, controller)
        if setup.predecessor is None:
            return Leader(
                own_state=own_state,
                controller=controller,
                speed_law=self._profile(start_at),
                control=control,
                path=self._route.path,
                station=self._route.start_station(0),
                limit=self._command_limit(),
                load=load,
            )
        steering = setup.steering
        return Follower(
            own_state=own_state,
            controller=controller,
            speed_law=self._speed_law(start_at),
            control=control,
            plane=self._plane,
            lead=setup.lead,
            predecessor=setup.predecessor,
            alpha=steering.alpha_ratio,
            fusion=steering.fusion,
            settings=self._fit_settings(),
            limit=self._command_limit(),
            load=load,
        )

    def _load_watch(self, *told: object) -> LoadWatch:
        """What tells those who can assume another car than they were made for."""
        setup = self._setup
        if not setup.steering.estimate_slip:
            return LoadWatch()
        noise = 0.0 if setup.knows_itself else setup.imu.yaw_rate_noise_radps
        estimator = SlipEstimator(setup.assumed_parameters, noise)
        return LoadWatch(estimator, [one for one in told if isinstance(one, Assuming)])

    def _command_limit(self) -> CommandLimit:
        car = self._setup.parameters
        return CommandLimit(car.steering_rate_limit, 1.0 / self.control_rate_hz, car.steering_limit)

    def _fit_settings(self) -> FitSettings:
        """The fit assumes the largest error of the receivers received from, at least that of RTK.

        Its tolerance is the scenario's, or five times that noise if that is more (the paper's
        10 cm are five times the 2 cm of RTK). That is the error in the worst state that a receiver
        can be in, without what all have in common; the fit finds out itself where it is smaller.
        """
        steering = self._setup.steering
        receivers = (self._scenario.vehicle(name).gnss for name in self._setup.senders)
        noise = max(FitSettings().position_noise, *map(assumed_deviation, receivers))
        return FitSettings(
            preview_time=steering.preview_s,
            tolerance=max(steering.tolerance_m, 5.0 * noise),
            position_noise=noise,
            trajectory=steering.trajectory,
        )

    def _controller(self) -> LateralController:
        setup = self._setup
        return load_controller(setup.controller, setup.assumed_parameters, setup.gains)

    def _profile(self, start_at: int) -> SpeedLaw:
        return ProfileSpeed(self._route.profile, start_at, 1.0 / self.control_rate_hz)

    def _speed_law(self, start_at: int) -> SpeedLaw:
        if self._scenario.tables.speed.followers == "same":
            return self._profile(start_at)
        return GapKeeping(self._scenario.gap_policy, self._scenario.gap_limits)
