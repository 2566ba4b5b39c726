"""The lead drives its own path with the steering law of the followers."""

from collections.abc import Sequence

from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix
from vehicles.car.imu import Motion
from vehicles.driver.command_limit import CommandLimit
from vehicles.driver.decision import Decision
from vehicles.driver.degradation.slowing.waiting import ConvoyWatch, WaitingProfile
from vehicles.driver.ego.own_state import OwnState, Pose
from vehicles.driver.ego.slip_estimator import LoadWatch
from vehicles.driver.speed import SpeedLaw, VehiclesAhead
from vehicles.driver.steering import LateralController
from vehicles.driver.tracking import TrackingErrors
from vehicles.geometry.geodesy import wrap_angle
from vehicles.geometry.path import Path
from vehicles.messages import GpsPose
from vehicles.schedule import Cadence


class Leader:
    """Tracks a path from a given station (m) on (Section V-C, Fig. 8).

    It receives nothing, or what its followers say where it waits for them.
    """

    def __init__(
        self,
        *,
        own_state: OwnState,
        controller: LateralController,
        speed_law: SpeedLaw,
        control: Cadence,
        path: Path,
        station: float,
        limit: CommandLimit | None = None,
        load: LoadWatch | None = None,
        waiting: tuple[ConvoyWatch, WaitingProfile] | None = None,
    ) -> None:
        """`station` is the arc length at which the lead starts; `limit` that of its steering.

        `load` watches how heavily it is laden, if anything does; `waiting` are who watches over
        the followers, and the speed law that is told, where it waits for them.
        """
        self._own_state = own_state
        self._controller = controller
        self._speed_law = speed_law
        self._control = control
        self._path = path
        self._near = station
        self._limit = limit or CommandLimit()
        self._load = load or LoadWatch()
        self._waiting = waiting
        self._reason = ""
        self._decision: Decision | None = None

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[GpsPose],
    ) -> Decision:
        """Decide at `now` (ns); between control instants the last decision is held.

        Errors of Section III-B against the path itself, steering of Section III-C.
        """
        self._load.observe(now, motion)
        self._own_state.update(now, fix, motion)
        if self._waiting is not None:
            watch, law = self._waiting
            self._reason = watch.observe(now, received)
            law.waits = bool(self._reason)
        if self._decision is not None and not self._control.due(now):
            return self._decision.held()
        pose = self._own_state.at(now)
        errors = self._track(pose)
        steering = self._limit.held_back(self._controller.steer(errors, pose.speed))
        self._load.commanded(steering.steering)
        speed = self._speed_law.command(now, pose, VehiclesAhead())
        self._decision = Decision(
            actuation=Actuation(steering.steering, speed.acceleration),
            steering=steering,
            errors=errors,
            mode="path",
            reason=self._reason,
            target_speed=speed.target_speed,
        )
        return self._decision

    def _track(self, pose: Pose) -> TrackingErrors:
        foot = self._path.project(pose.east, pose.north, self._near)
        # At rare decisions the next place lies beyond the window of the projection.
        self._near = foot.station + pose.speed / self._control.rate_hz
        return TrackingErrors(
            lateral=foot.lateral,
            heading=wrap_angle(pose.yaw - foot.yaw),
            yaw_rate=pose.yaw_rate - pose.speed * foot.curvature,
            curvature=foot.curvature,
            path=self._path,
            station=foot.station,
        )
