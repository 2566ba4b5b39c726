"""Fusions of sources and degradation policies as plug-ins."""

from collections.abc import Sequence

import numpy as np

from scenarios.definition.schema.plug_ins.point import (
    PlugInError,
    PlugInPoint,
    called,
    finite,
)
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.driver.controller import (
    LongitudinalController,
    LongitudinalSetup,
    OwnMotion,
    SourceState,
    VehiclesAhead,
)
from vehicles.driver.reactions import CHOSEN, ReactionPolicy
from vehicles.driver.situation import Situation
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.messages import Mode
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.fusion import SourceFusion, Trajectories
from vehicles.preview.samples import Window
from vehicles.preview.trajectory import LEAD, PREDECESSOR, Fit, SourceWindow

# ---- Lateral controllers as plug-ins


class GuardedSteering:
    """Wraps a user's controller (Section III-C), and converts its faults to PlugInError."""

    def __init__(self, controller: LateralController, name: str) -> None:
        self._controller = controller
        self._what = f"controller {name!r}: steer()"

    def steer(self, errors: TrackingErrors, speed: float) -> SteeringCommand:
        command = called(lambda: self._controller.steer(errors, speed), self._what)
        return steering_command(command, self._what)


def steering_command(command: object, what: str) -> SteeringCommand:
    """Return a finite command; raises PlugInError, beginning with `what`."""
    if not isinstance(command, SteeringCommand):
        given = type(command).__name__
        raise PlugInError(f"{what} returned {given}, expected a SteeringCommand")
    parts = [
        finite(getattr(command, part), f"{what} returned {part}", "number of radians")
        for part in ("steering", "feedforward", "feedback")
    ]
    return SteeringCommand(*parts)


def try_steering(controller: LateralController) -> list[SteeringCommand]:
    """Call `steer` at 10 m/s, on a straight without errors and 0.1 m to the left."""
    return [
        controller.steer(TrackingErrors(lateral, heading=0.0, yaw_rate=0.0, curvature=0.0), 10.0)
        for lateral in (0.0, 0.1)
    ]


LATERAL = PlugInPoint(
    name="controller",
    title="lateral controller",
    key="control.controller",
    shipped={
        "slip_compensated": "vehicles.driver.steering.SlipCompensated",
        "feedforward_feedback": "vehicles.driver.steering.FeedforwardFeedback",
        "stanley": "vehicles.driver.steering.Stanley",
        "pure_pursuit": "vehicles.driver.steering.PurePursuit",
    },
    contract=LateralController,
    methods={"steer": "errors, speed"},
    types=(TrackingErrors, SteeringCommand, VehicleParameters, Gains),
    arguments="parameters, gains",
    draws=True,
    guard=GuardedSteering,
    trial=try_steering,
)


# ---- Path


class GuardedFusion:
    """Wraps a user's fusion, and converts its faults to PlugInError."""

    def __init__(self, fusion: SourceFusion, name: str) -> None:
        self._fusion = fusion
        self._what = f"fusion {name!r}: fuse()"
        self.separate = getattr(fusion, "separate", False)

    def fuse(self, sources: Sequence[SourceWindow], settings: FitSettings) -> Trajectories:
        found: object = called(lambda: self._fusion.fuse(sources, settings), self._what)
        result: list[tuple[float, Fit]] = []
        for entry in found if isinstance(found, list | tuple) else [found]:
            if not isinstance(entry, tuple) or len(entry) != 2 or not isinstance(entry[1], Fit):
                given = type(entry).__name__
                raise PlugInError(
                    f"{self._what} returned {given}, expected a list of tuples (share, Fit)"
                )
            share = finite(entry[0], f"{self._what} returned the share", "number")
            result.append((share, entry[1]))
        return result


def try_fusion(fusion: SourceFusion) -> list[float]:
    """Fuse two straight traces, and either of them alone; returns shares and residuals."""
    station = np.arange(-10.0, 40.0, 2.0)
    lead = SourceWindow(LEAD, 0.5, Window(station, 0.01 * station, station))
    ahead = Window(station + 1.0, 0.01 * station, station + 1.0)
    predecessor = SourceWindow(PREDECESSOR, 0.5, ahead)
    cases = ([lead, predecessor], [predecessor], [lead])
    found = [fusion.fuse(sources, FitSettings()) for sources in cases]
    return [number for one in found for share, fit in one for number in (share, fit.residual_rms)]


class GuardedReaction:
    """Wraps a user's degradation policy, and converts its faults to PlugInError."""

    def __init__(self, policy: ReactionPolicy, name: str) -> None:
        self._policy = policy
        self._what = f"reaction {name!r}"

    def mode(self, situation: Situation, usual: Mode, speed: float) -> Mode:
        what = f"{self._what}: mode()"
        mode: object = called(lambda: self._policy.mode(situation, usual, speed), what)
        allowed = (usual, *CHOSEN)
        if mode in allowed:
            return mode
        raise PlugInError(f"{what} returned {mode!r}, expected one of {', '.join(allowed)}")

    def steering(
        self, mode: Mode, command: SteeringCommand, last: SteeringCommand
    ) -> SteeringCommand:
        what = f"{self._what}: steering()"
        return steering_command(
            called(lambda: self._policy.steering(mode, command, last), what), what
        )

    def acceleration(self, situation: Situation, mode: Mode, speed: float, wanted: float) -> float:
        what = f"{self._what}: acceleration()"
        value = called(lambda: self._policy.acceleration(situation, mode, speed, wanted), what)
        return finite(value, f"{what} returned", "acceleration (m/s²)")


def try_reaction(policy: ReactionPolicy) -> list[object]:
    """Call the methods without a source."""
    command, last = SteeringCommand(0.1, 0.1, 0.0), SteeringCommand(0.05, 0.05, 0.0)
    modes: tuple[Mode, ...] = ("composite", "coast")
    situation = Situation()
    situation.ahead = VehiclesAhead()
    return [
        (
            policy.mode(situation, mode, 20.0),
            policy.steering(mode, command, last),
            policy.acceleration(situation, mode, 20.0, 0.0),
        )
        for mode in modes
    ]


FUSION = PlugInPoint(
    name="fusion",
    title="fusion of the sources",
    key="control.fusion",
    shipped={
        "composite": "vehicles.preview.fusion.CompositeFusion",
        "blend": "vehicles.preview.fusion.BlendFusion",
    },
    contract=SourceFusion,
    methods={"fuse": "sources, settings"},
    types=(SourceWindow,),
    draws=True,
    guard=GuardedFusion,
    trial=try_fusion,
)
REACTION = PlugInPoint(
    name="reaction",
    title="degradation policy",
    key="control.degradation.reaction",
    shipped={
        "degrade": "vehicles.driver.reactions.Degrade",
        "extrapolate": "vehicles.driver.reactions.Extrapolate",
        "hold": "vehicles.driver.reactions.Hold",
        "straight": "vehicles.driver.reactions.Straight",
    },
    contract=ReactionPolicy,
    methods={
        "mode": "situation, usual, speed",
        "steering": "mode, command, last",
        "acceleration": "situation, mode, speed, wanted",
    },
    types=(SteeringCommand,),
    draws=True,
    guard=GuardedReaction,
    trial=try_reaction,
)


# ---- Longitudinal controllers as plug-ins


class GuardedFollowing:
    """Wraps a user's longitudinal controller, and converts its faults to PlugInError."""

    def __init__(self, controller: LongitudinalController, name: str) -> None:
        self._controller = controller
        self._what = f"controller {name!r}: acceleration()"

    def acceleration(self, speed: float, ahead: VehiclesAhead) -> float:
        value = called(lambda: self._controller.acceleration(speed, ahead), self._what)
        return finite(value, f"{self._what} returned", "acceleration (m/s²)")


def try_following(controller: LongitudinalController, setup: LongitudinalSetup) -> list[float]:
    """Call `acceleration` at 20 m/s, 1 m too far behind sources of that speed, and at 18 m/s."""
    accelerations = []
    for speed in (20.0, 18.0):
        ahead = VehiclesAhead(
            own=OwnMotion(setup.period),
            sources={
                name: SourceState("fresh", 0.1, speed=20.0, spacing=policy.desired(speed) + 1.0)
                for name, policy in setup.policies.items()
            },
        )
        if setup.predecessor in setup.policies:
            ahead.spacing, ahead.predecessor_speed = setup.policy.desired(speed) + 1.0, 20.0
        if setup.lead in setup.policies:
            ahead.lead_speed, ahead.lead_acceleration = 20.0, 0.0
        accelerations.append(controller.acceleration(speed, ahead))
    return accelerations


LONGITUDINAL = PlugInPoint(
    name="controller",
    title="longitudinal controller",
    key="control.longitudinal",
    shipped={
        name: f"vehicles.driver.longitudinal_laws.{law}"
        for name, law in (
            ("gap", "GapLaw"),
            ("acc", "Acc"),
            ("cacc", "Cacc"),
            ("ploeg", "Ploeg"),
            ("flatbed", "Flatbed"),
            ("consensus", "Consensus"),
        )
    },
    contract=LongitudinalController,
    methods={"acceleration": "speed, ahead"},
    types=(LongitudinalSetup, VehiclesAhead, OwnMotion, SourceState),
    arguments="setup",
    draws=True,
    guard=GuardedFollowing,
    trial=try_following,
)
