"""Motion that follows a path exactly, against closed forms and the simulated car."""

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import Loading, VehicleParameters, loaded
from vehicles.car.path_keeping import PathKeeping
from vehicles.geometry.arc_spline import ArcSpline, Piece

FULL = loaded(CAR, Loading(front_passengers=1, rear_passengers=3))
SPEEDS = [3.0, 12.0, 30.0]


Curvatures = Callable[[float, float, int], list[float]]


def sampled(curvature: Callable[[float], float]) -> Curvatures:
    """Sample a curvature function as `PathKeeping.motion` requires."""
    return lambda start, step, count: [curvature(start + k * step) for k in range(count)]


def steady(car: VehicleParameters, speed: float) -> tuple[float, float]:
    """Slip and steering per curvature on an arc, in closed form from forces and moments."""
    a, b, length = car.front_axle_distance, car.rear_axle_distance, car.wheelbase
    front = car.mass * speed**2 * b / (length * car.front_cornering_stiffness)
    rear = car.mass * speed**2 * a / (length * car.rear_cornering_stiffness)
    return b - rear, length + front - rear


@pytest.mark.parametrize("car", [CAR, FULL])
@pytest.mark.parametrize("speed", SPEEDS)
def test_on_an_arc_it_is_steady_cornering(car: VehicleParameters, speed: float) -> None:
    slip, steering = steady(car, speed)
    motion = PathKeeping(car).motion(sampled(lambda _: -0.002), (0.0, 5.0), speed)
    assert motion.curvature.mean(0.0, 0.0) == pytest.approx(-0.002, rel=1e-5)
    assert motion.heading.mean(0.0, 0.0) == pytest.approx(0.002 * slip, rel=1e-5)
    assert motion.steering.mean(0.0, 0.0) == pytest.approx(-0.002 * steering, rel=1e-5)


@pytest.mark.parametrize("speed", [1.5, 4.0, 6.0])
@pytest.mark.parametrize("radius", [-7.0, 12.0])
def test_the_simulated_car_follows_a_tight_arc_at_large_slip(speed: float, radius: float) -> None:
    """Radius, slip and yaw rate are those of the steady state with large angles."""
    motion = PathKeeping(CAR).motion(sampled(lambda _: 1.0 / radius), (0.0, 5.0), speed)
    body = Body(0.0, 0.0, 0.0, speed)
    for _ in range(300):
        body = advance(body, Actuation(motion.steering.mean(0.0, 0.0), 0.0), 0.02, CAR)
    along = math.hypot(body.speed, body.lateral_speed)
    assert along / body.yaw_rate == pytest.approx(radius, rel=2e-3)
    slip = math.atan2(body.lateral_speed, body.speed)
    assert abs(slip) > 0.1
    assert motion.heading.mean(0.0, 0.0) == pytest.approx(-slip, rel=5e-3)
    assert motion.curvature.mean(0.0, 0.0) * body.speed == pytest.approx(body.yaw_rate, rel=2e-3)


@pytest.mark.parametrize("car", [CAR, FULL])
@pytest.mark.parametrize("speed", SPEEDS)
def test_on_a_clothoid_it_has_the_first_order_terms(car: VehicleParameters, speed: float) -> None:
    """Lateral force m v² κ and moment I v² κ' on a path whose curvature grows by κ'."""
    rate, length = 2e-4, car.wheelbase
    slip, steering = steady(car, speed)
    motion = PathKeeping(car).motion(sampled(lambda distance: rate * distance), (0.0, 40.0), speed)
    there = 35.0  # the assumed initial motion has decayed
    front, rear = car.front_cornering_stiffness, car.rear_cornering_stiffness
    moment = car.yaw_inertia * speed**2 / length
    lag = moment / rear - car.rear_axle_distance * slip
    assert motion.heading.mean(there, 0.0) == pytest.approx(
        -rate * (there * slip + lag), abs=1e-3 * rate
    )
    kick = moment * (1.0 / front + 1.0 / rear) - slip * length
    assert motion.steering.mean(there, 0.0) == pytest.approx(
        rate * (there * steering + kick), abs=1e-2 * rate
    )


def test_at_walking_pace_the_body_turns_in_over_the_rear_axle_s_distance() -> None:
    b, motion = (
        CAR.rear_axle_distance,
        PathKeeping(CAR).motion(sampled(lambda s: 0.1 * (s > 0.0)), (0.0, 4.0), 1.0),
    )
    for distance in (1.0, 2.0, 4.0):
        turned_in = -0.1 * b * (1.0 - math.exp(-distance / b))
        assert motion.heading.mean(distance, 0.0) == pytest.approx(turned_in, rel=0.15)


@given(speed=st.floats(0.0, 40.0), at=st.floats(-5.0, 5.0))
def test_before_the_curvature_changes_it_is_that_of_an_arc(speed: float, at: float) -> None:
    keeping, curvature = PathKeeping(CAR), 0.01
    bend = keeping.motion(sampled(lambda s: curvature + 0.02 * (s > at)), (-6.0, 6.0), speed)
    arc = keeping.motion(sampled(lambda _: curvature), (-6.0, 6.0), speed)
    where = at - bend.heading.step  # the motion is linear between samples
    for changing, constant in zip(bend, arc, strict=True):
        assert changing.mean(where, 0.0) == pytest.approx(constant.mean(where, 0.0), rel=1e-12)
        assert changing.mean(6.0, 0.0) != constant.mean(6.0, 0.0)


def bends(distance: float) -> float:
    """Curvature (1/m) up to a radius of 400 m, with corners and smooth."""
    if distance < 20.0:
        return 0.0
    return min((distance - 20.0) / 30.0, 1.0, max(0.0, (130.0 - distance) / 60.0)) / 400.0


def road() -> ArcSpline:
    pieces = [Piece(0.0, 0.0, 0.0, 0.0, 20.0)]
    for curvature, length, rate in (
        (0.0, 30.0, 1 / 12000),
        (1 / 400, 20.0, 0.0),
        (1 / 400, 60.0, -1 / 24000),
        (0.0, 60.0, 0.0),
    ):
        end = pieces[-1].at(pieces[-1].length)
        pieces.append(Piece(end.east, end.north, end.yaw, curvature, length, rate))
    return ArcSpline(pieces)


@pytest.mark.spread(3)
@pytest.mark.parametrize("car", [CAR, FULL])
@pytest.mark.parametrize("speed", [10.0, 20.0, 30.0])
def test_the_simulated_car_follows_the_road_without_feedback(
    car: VehicleParameters, speed: float
) -> None:
    """Its slip is much closer than by steady cornering, and it stays on the road for 150 m.

    Without feedback a place is twice the integral of what is left.
    """
    quick = replace(car, steering_frequency=500.0, steering_damping=0.7)
    body, span, path = Body(0.0, 0.0, 0.0, speed), 0.005, road()
    off_road, off_slip, off_steady = [], [], []
    while body.distance < 150.0:
        motion = PathKeeping(quick).motion(seen_from(body.distance), (0.0, 2.0), speed)
        off_road.append(abs(path.project(body.east, body.north).lateral))
        slip = body.lateral_speed / speed
        off_slip.append(abs(slip + motion.heading.mean(0.0, 0.0)))
        off_steady.append(abs(slip - steady(car, speed)[0] * motion.curvature.mean(0.0, 0.0)))
        halfway = PathKeeping(quick).motion(
            seen_from(body.distance + 0.5 * span * speed), (0.0, 2.0), speed
        )
        body = advance(body, Actuation(halfway.steering.mean(0.0, 0.0), 0.0), span, quick)
    assert max(off_slip) < 0.15 * max(off_steady)
    assert max(off_road) < 0.03


def seen_from(place: float) -> Curvatures:
    """Curvatures by the distance from a point on the road."""
    return sampled(lambda distance: bends(place + distance))


@given(speed=st.floats(0.0, 60.0), curvature=st.floats(-0.2, 0.2), at=st.floats(-30.0, 10.0))
def test_it_is_finite_and_mirrored_for_the_other_turn(
    speed: float, curvature: float, at: float
) -> None:
    def means(bend: float) -> list[float]:
        motion = PathKeeping(CAR).motion(sampled(lambda s: bend * (s > at)), (-1.0, 6.0), speed)
        return [along.mean(1.0, 2.0) for along in motion]

    assert all(map(math.isfinite, means(curvature)))
    assert means(curvature) == pytest.approx([-value for value in means(-curvature)])
