"""Drives of the car model under given commands, for the tests of the model."""

import math
from collections.abc import Callable

from vehicles.car.dynamics import Actuation, Body, CarMotion
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import VehicleParameters

TICK = 0.02


def advance(body: Body, actuation: Actuation, span: float, car: VehicleParameters) -> Body:
    return CarMotion(car).advance(body, actuation, span)


def drive(
    body: Body,
    command: Callable[[float], Actuation],
    duration: float,
    *,
    tick: float = TICK,
    car: VehicleParameters = CAR,
) -> list[Body]:
    bodies = [body]
    for k in range(round(duration / tick)):
        bodies.append(advance(bodies[-1], command(k * tick), tick, car))
    return bodies


def steer(angle: float, acceleration: float = 0.0) -> Callable[[float], Actuation]:
    return lambda _: Actuation(angle, acceleration)


def lane_change(seconds: float) -> Actuation:
    """Steering of a lane change at 30 m/s on arcs of 300 m: left, right, left."""
    bend = (CAR.wheelbase + CAR.steer_gradient * 30.0**2) / 300.0
    sign = 1 if seconds < 1.0 else -1 if seconds < 3.0 else 1 if seconds < 4.0 else 0
    return Actuation(sign * bend, 0.0)


def apart(left: Body, right: Body) -> float:
    return math.hypot(left.east - right.east, left.north - right.north)
