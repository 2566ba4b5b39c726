"""A car that follows received samples on courses that come close to themselves."""

import math

import numpy as np
import pytest

from tests.made.transport.received_poses import received
from tests.made.vehicles.arc_courses import course
from tests.made.vehicles.driving import advance
from tests.made.vehicles.fusions import fit_two
from tests.made.vehicles.laps import TICK, Place, bulb, eight, lap
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.driver.controller import GapLimits
from vehicles.driver.own_state import Pose
from vehicles.driver.speed import BEND_RATE, BendsAhead
from vehicles.driver.steering import SlipCompensated
from vehicles.driver.tracking import track
from vehicles.geometry.sampled_path import Segment, path_from_segments
from vehicles.preview.curve_fit import FitSettings
from vehicles.preview.trace import Trace

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
        fit = fit_two(seen, None, alpha=0.5, settings=settings) or fit
        for _ in range(2):
            errors = track(fit.spline, body) if fit else None
            steering = controller.steer(errors, speed).steering if errors else 0.0
            body = advance(body, Actuation(steering, 0.0), 0.025, CAR)
        station, away = cross_track(place, station + speed * 0.05, body)
        worst = max(worst, away)
    assert station == pytest.approx(length - gap, abs=6.0)
    assert worst < 0.4


# ---- Bends of the received path

LATERAL, BRAKING = 6.0, 2.5
PATH = path_from_segments(
    (Segment(100.0, 0.0), Segment(30.0, 1 / 40.0), Segment(50.0, 0.0), Segment(40.0, -1 / 15.0))
)
LIMITS = GapLimits(lateral=LATERAL, before_bends=BRAKING)


def driven_by_a_source(bends: BendsAhead, until: float, speed: float = 12.0) -> None:
    """Send a pose every 0.6 m of the path up to `until` (m)."""
    for k in range(int(until / 0.6) + 1):
        place = PATH.at(0.6 * k)
        bends.add(
            received(
                50_000_000 * (k + 1),
                place.east,
                place.north,
                place.yaw,
                speed,
                yaw_rate=speed * place.curvature,
            )
        )


def allowed_by_hand(station: float) -> float:
    """Squared speed from which braking reaches that of each bend at its start."""
    starts = {100.0: 40.0, 180.0: 15.0}
    ends = {100.0: 130.0, 180.0: 220.0}
    return min(
        LATERAL * radius + 2.0 * BRAKING * max(start - station, 0.0)
        for start, radius in starts.items()
        if station < ends[start]
    )


@pytest.mark.parametrize("station", [10.0, 60.0, 99.0, 115.0, 140.0, 175.0, 200.0])
def test_the_speed_allowed_now_is_that_from_which_a_car_can_brake(station: float) -> None:
    """The car brakes at 2.5 m/s² in advance, which is as 1.25 m/s of excess."""
    bends = BendsAhead(LATERAL, LIMITS)
    driven_by_a_source(bends, PATH.length)
    place, allowed = PATH.at(station), math.sqrt(allowed_by_hand(station))
    for excess, sign in ((0.5, -1.0), (-0.5 - BRAKING / BEND_RATE, 1.0)):
        pose = Pose(place.east, place.north, place.yaw, allowed + excess, 0.0)
        assert sign * bends.acceleration(pose) > 0.0


def test_a_car_that_brakes_in_time_enters_a_bend_no_faster_than_it_allows() -> None:
    bends = BendsAhead(LATERAL, LIMITS)
    driven_by_a_source(bends, PATH.length)
    station, speed, hardest = 0.0, 22.0, 0.0
    while station < 110.0:
        place = PATH.at(station)
        pose = Pose(place.east, place.north, place.yaw, speed, 0.0)
        acceleration = min(bends.acceleration(pose), 0.0)
        hardest = min(hardest, acceleration)
        if 99.0 < station < 100.0:
            assert speed < math.sqrt(LATERAL * 40.0) + 0.6
        station += 0.02 * speed
        speed += 0.02 * acceleration
    assert -BRAKING - 1.0 < hardest < 0.0
