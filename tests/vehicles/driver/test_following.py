"""A car that follows received samples on courses that come close to themselves."""

import math

import numpy as np
import pytest

from tests.made.transport.received_poses import received
from tests.made.vehicles.arc_courses import course
from tests.made.vehicles.driving import advance
from tests.made.vehicles.laps import TICK, Place, bulb, eight, lap
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.steering import SlipCompensated
from vehicles.driver.tracking import track
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.trace import Trace
from vehicles.preview.trajectory import fit_composite

COURSES: dict[str, tuple[Place, float]] = {
    "bulb turn": (lap(bulb(radius=12.0)), bulb(radius=12.0).length - 1.0),
    "figure of eight": (eight, 4.0 * math.pi * 15.0 * 2.0),
    "three laps": (lap(course([(1 / 20, 40 * math.pi)])), 3.0 * 40.0 * math.pi),
}


def cross_track(place: Place, station: float, body: Body) -> tuple[float, float]:
    """Nearest station (m) of the course around `station` (m), and the distance from it (m)."""
    around = np.arange(station - 1.0, station + 2.0, 0.02)
    away = [
        math.hypot(body.east - east, body.north - north)
        for east, north, _ in (place(max(0.0, float(s))) for s in around)
    ]
    nearest = int(np.argmin(away))
    return float(around[nearest]), away[nearest]


@pytest.mark.spread(2)
@pytest.mark.parametrize("name", COURSES)
def test_a_car_follows_the_leg_that_was_driven(name: str) -> None:
    place, length = COURSES[name]
    speed, gap, settings = 5.0, 8.0, FitSettings()
    random, trace, controller = np.random.default_rng(2), Trace(), SlipCompensated(CAR)
    body, station, fit, worst = Body(*place(0.0), speed), 0.0, None, 0.0
    for k in range(int((length - gap - 3.0) / speed * 20.0)):  # per fix of 20 Hz, at 40 Hz control
        east, north, yaw = place(gap + speed * 0.05 * k)
        noise = 0.02 * random.standard_normal(2)
        trace.add(received((k + 1) * TICK, east + noise[0], north + noise[1], yaw, speed))
        trace.bridge(body.east, body.north, body.yaw)
        seen = trace.window(body.east, body.north, settings.behind(speed), settings.ahead(speed))
        fit = fit_composite(seen, None, alpha=0.5, settings=settings) or fit
        for _ in range(2):
            errors = track(fit.spline, body) if fit else None
            steering = controller.steer(errors, speed).steering if errors else 0.0
            body = advance(body, Actuation(steering, 0.0), 0.025, CAR)
        station, away = cross_track(place, station + speed * 0.05, body)
        worst = max(worst, away)
    assert station == pytest.approx(length - gap, abs=6.0)
    assert worst < 0.4
