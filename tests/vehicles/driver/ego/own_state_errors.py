"""Errors of the own-state filter over its own deviations (NEES), with an emulated receiver."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import remainder, tau

import numpy as np

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.gnss import Fix, GnssReceiver
from vehicles.car.gnss_error_terms import ReceiverContext
from vehicles.car.gnss_settings import GnssSettings, stated_errors
from vehicles.car.imu import ImuSettings, InertialSensor
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import VehicleParameters
from vehicles.driver.pose_estimator import PoseEstimator

MS = 1_000_000
WARM_UP_S = 2.0


@dataclass(frozen=True)
class Course:
    """Initial state of a car, and its commands over time (s)."""

    body: Body
    command: Callable[[float], Actuation]


@dataclass(frozen=True)
class EstimatedDrive:
    """A car with a receiver, driven along a course for `seconds`; the first 2 s are left out.

    The filter assumes an empty car. With `white_only` it ignores the receiver's error model.
    """

    gnss: GnssSettings
    course: Course
    seconds: float = 30.0
    car: VehicleParameters = CAR
    white_only: bool = False

    def normalised_squares(self, seed: int) -> np.ndarray:
        """Squared errors over variances, (n, 3): along, across, heading, once per 100 ms."""
        rows = [row for at, row in self._run(seed) if at >= WARM_UP_S]
        return np.array(rows)

    def _run(self, seed: int) -> Iterator[tuple[float, list[float]]]:
        body, random = self.course.body, np.random.default_rng([seed, 0])
        gnss = GnssReceiver(self.gnss, receiver_context(seed), random)
        imu = InertialSensor(ImuSettings(), 50.0, 0, np.random.default_rng([seed, 1]))
        own_state = self._estimator(body)
        for k in range(round(self.seconds * 100)):
            now = k * 10 * MS
            own_state.update(now, gnss.measure(body, now), imu.measure(body, now))
            if k % 10 == 0:
                yield k * 0.01, _normalised(own_state, body, now)
            body = advance(body, self.course.command(k * 0.01), 0.01, self.car)

    def _estimator(self, body: Body) -> PoseEstimator:
        gnss = self.gnss
        start = Fix(
            0, 0, body.east, body.north, remainder(body.yaw, tau), body.speed, body.yaw_rate
        )
        stated = None if self.white_only else stated_errors(gnss)
        estimator = PoseEstimator(CAR, gnss, stated=stated, start=start, latency=gnss.latency)
        if not gnss.has_fix_every_instant:
            estimator.begin(start)
        return estimator


def receiver_context(seed: int) -> ReceiverContext:
    def stream(purpose: str, kind: int) -> np.random.Generator:
        return np.random.default_rng([seed, kind, *purpose.encode()])

    return ReceiverContext(0, 0.0, lambda p: stream(p, 2), lambda p: stream(p, 3))


def _normalised(own_state: PoseEstimator, body: Body, now: int) -> list[float]:
    pose, deviations = own_state.at(now), own_state.deviations
    east, north = pose.east - body.east, pose.north - body.north
    cos, sin = math.cos(body.yaw), math.sin(body.yaw)
    errors = east * cos + north * sin, north * cos - east * sin, remainder(pose.yaw - body.yaw, tau)
    return [(error / deviation) ** 2 for error, deviation in zip(errors, deviations, strict=True)]
