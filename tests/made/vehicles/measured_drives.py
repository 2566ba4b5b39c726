"""Measured drives of a car as received by another vehicle, optionally falsified."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tests.made.transport.received_poses import received_fix
from tests.made.vehicles.driving import advance
from tests.made.vehicles.exact_drives import PLANE, START
from tests.made.vehicles.receivers import USUAL, receiver
from transport.links.laws.content import FalseContent, GhostVehicle
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix, to_message
from vehicles.car.gnss_settings import GnssSettings
from vehicles.car.parameters import LINCOLN_MKZ, VehicleParameters
from vehicles.driver.plausibility import REFUSED, Distrust, PoseJudge
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import MILLISECOND, SECOND

_Pose = TypeVar("_Pose", Fix, ReceivedPose)
TICK_S = 0.01
LATENCY = 20 * MILLISECOND
Command = Callable[[float, Body], Actuation]


def constant_motion(
    speed: float, curvature: float = 0.0, car: VehicleParameters = LINCOLN_MKZ
) -> Command:
    """Command of a constant curvature (1/m) at a speed (m/s)."""
    wheel = curvature * (car.wheelbase + car.steer_gradient * speed * speed)
    return lambda _seconds, _body: Actuation(wheel, 0.0)


def random_motion(
    seed: int, *, lateral: float = 8.0, braking: float = 8.0, fastest: float = 35.0
) -> Command:
    """Command of random bends, swerves, braking and stops, changed every half second.

    `lateral`, `braking` (m/s²) and `fastest` (m/s) are the limits.
    """
    random = np.random.default_rng(seed)
    drawn = random.uniform(-1.0, 1.0, (10_000, 2)).tolist()

    def command(seconds: float, body: Body) -> Actuation:
        bend, push = drawn[int(2.0 * seconds)]
        speed = max(body.speed, 1.0)
        curvature = bend * min(lateral / speed**2, 0.18)
        car = LINCOLN_MKZ
        wheel = curvature * (car.wheelbase + car.steer_gradient * speed * speed)
        acceleration = braking * push if body.speed < fastest else -abs(push)
        return Actuation(wheel, acceleration)

    return command


def measured_fixes(
    command: Command,
    *,
    seconds: float = 10.0,
    speed: float = 20.0,
    settings: GnssSettings = USUAL,
    seed: int = 1,
    car: VehicleParameters = LINCOLN_MKZ,
) -> list[Fix]:
    gnss = receiver(settings, START, seed)
    body, fixes, now = Body(100.0, -50.0, 0.7, speed), [], START
    tick = round(TICK_S * SECOND)
    while now < START + seconds * SECOND:
        fix = gnss.measure(body, now)
        if fix is not None:
            fixes.append(fix)
        body = advance(body, command((now - START) / SECOND, body), TICK_S, car)
        now += tick
    return fixes


def pose_of(fix: Fix) -> GpsPose:
    return to_message(
        fix, "v1", PLANE, seq=fix.seq, sent_at=fix.measured_at, true_position=(0.0, 0.0, 0.0)
    )


def falsify(fixes: Sequence[Fix], false: FalseContent) -> list[ReceivedPose]:
    poses = [pose_of(fix) for fix in fixes]

    def recall(until: int) -> GpsPose | None:
        return next((pose for pose in reversed(poses) if pose.sent_at_ns <= until), None)

    received: list[ReceivedPose] = []
    for pose in poses:
        acts = pose.sent_at_ns in false.span
        falsified = false.falsify(pose, PLANE, recall) if acts else None
        received.append(_received(falsified or pose))
        if acts and isinstance(false, GhostVehicle):
            received.append(_received(false.extra_message(pose, PLANE)))
    return received


def _received(message: GpsPose) -> ReceivedPose:
    return receive(message, PLANE, message.measured_at_ns + LATENCY)


def thinned(fixes: Iterable[_Pose], share: float, seed: int) -> list[_Pose]:
    random = np.random.default_rng(seed)
    return [fix for fix in fixes if random.random() < share]


@dataclass(frozen=True)
class Judged:
    pose: ReceivedPose
    reason: Distrust

    @property
    def seconds(self) -> float:
        return (self.pose.measured_at - START) / SECOND

    @property
    def refused(self) -> bool:
        return self.reason in REFUSED


def judged(fixes: Iterable[Fix | ReceivedPose], gate: PoseJudge | None = None) -> list[Judged]:
    gate = gate or PoseJudge(receiver=USUAL)
    verdicts = []
    for fix in fixes:
        pose = fix
        if isinstance(pose, Fix):
            pose = received_fix(pose, received_at=pose.measured_at + LATENCY)
        verdicts.append(Judged(pose, gate.judge(pose)))
    return verdicts


def refused(verdicts: Iterable[Judged]) -> list[Judged]:
    return [verdict for verdict in verdicts if verdict.refused]
