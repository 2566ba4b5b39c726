import math
from collections.abc import Callable

import pytest

from tests.made.vehicles.arc_courses import course
from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Actuation, Body
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.parameters import NOMINAL_GAINS
from vehicles.driver.steering import (
    FeedforwardFeedback,
    LateralController,
    PurePursuit,
    SlipCompensated,
    Stanley,
)
from vehicles.driver.tracking import TrackingErrors, track
from vehicles.geometry.arc_spline import ArcSpline

CONTROLLERS: list[Callable[..., LateralController]] = [
    FeedforwardFeedback,
    SlipCompensated,
    Stanley,
    PurePursuit,
]


def drive(
    controller: LateralController, path: ArcSpline, speed: float, seconds: float, left: float = 0.0
) -> list[TrackingErrors]:
    """Steer the car along `path` from its start, with the true state, at 50 Hz."""
    body = Body(0.0, left, 0.0, speed)
    history = []
    for _ in range(round(50 * seconds)):
        errors = track(path, body)
        history.append(errors)
        command = controller.steer(errors, body.speed)
        body = advance(body, Actuation(command.steering, 0.0), 0.02, CAR)
    return history


def test_the_paper_s_law() -> None:
    errors = TrackingErrors(lateral=0.1, heading=0.02, yaw_rate=-0.05, curvature=1 / 300)
    command = FeedforwardFeedback(CAR).steer(errors, 30.0)
    # (a + b)/R + K_sg v²/R with K_sg = m (b C_r − a C_f) / ((a + b) C_f C_r)
    gradient = 1896 * (1.5818 * 381900 - 1.2682 * 400000) / (2.85 * 400000 * 381900)
    assert command.feedforward == pytest.approx(2.85 / 300 + gradient * 900 / 300)
    assert command.feedback == pytest.approx(-0.06 * 0.1 - 0.96 * 0.02 + 0.08 * 0.05)
    assert command.steering == command.feedforward + command.feedback


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_signs(controller: Callable[..., LateralController]) -> None:
    law = controller(CAR, NOMINAL_GAINS)
    assert law.steer(TrackingErrors(0.0, 0.0, 0.0, 0.0), 20.0).steering == 0.0
    assert law.steer(TrackingErrors(0.3, 0.0, 0.0, 0.0), 20.0).steering < 0.0  # left: steer right
    assert law.steer(TrackingErrors(0.0, 0.1, 0.0, 0.0), 20.0).steering < 0.0
    damped = law.steer(TrackingErrors(0.0, 0.0, 0.1, 0.0), 20.0).steering
    assert damped == 0.0 if controller is PurePursuit else damped < 0.0  # geometric: no damping
    assert law.steer(TrackingErrors(0.0, 0.0, 0.0, 0.01), 20.0).feedforward > 0.0  # left turn


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("lateral", [-1e3, 1e3])
def test_steering_is_limited_but_its_parts_are_not(
    controller: Callable[..., LateralController], lateral: float
) -> None:
    command = controller(CAR, NOMINAL_GAINS).steer(TrackingErrors(lateral, -lateral, 0.0, 0.0), 5.0)
    assert abs(command.steering) == CAR.steering_limit
    assert abs(command.feedback) > CAR.steering_limit


@pytest.mark.parametrize("controller", CONTROLLERS)
@pytest.mark.parametrize("speed", [3.0, 10.0, 30.0])
def test_an_offset_on_a_straight_road_decays(
    controller: Callable[..., LateralController], speed: float
) -> None:
    history = drive(controller(CAR, NOMINAL_GAINS), course([(0.0, 900.0)]), speed, 25.0, left=0.5)
    assert abs(history[-1].lateral) < 0.01
    assert min(error.lateral for error in history) > -0.25


CURVES = [(3.0, 1 / 40), (6.0, -1 / 20), (15.0, 1 / 80), (30.0, -1 / 300)]


def slip(speed: float) -> float:
    """Slip angle per curvature (m) in steady cornering: b − m a v² / ((a + b) C_r)."""
    a, b = CAR.front_axle_distance, CAR.rear_axle_distance
    return b - CAR.mass * a * speed**2 / ((a + b) * CAR.rear_cornering_stiffness)


@pytest.mark.parametrize(("speed", "curvature"), CURVES)
def test_the_paper_s_law_settles_beside_a_curve(speed: float, curvature: float) -> None:
    # The body stands at the slip angle β to the path, so θ̃ = −β, and k_e e_lat = k_θ β.
    path = course([(curvature, 0.5 * math.pi / abs(curvature))])
    settled = drive(FeedforwardFeedback(CAR), path, speed, 20.0 if speed < 10 else 15.0)[-1]
    beta = slip(speed) * curvature
    k_e, k_theta, _ = NOMINAL_GAINS
    assert settled.lateral == pytest.approx(k_theta * beta / k_e, rel=0.12)
    assert settled.heading == pytest.approx(-beta, rel=0.12)


@pytest.mark.parametrize(("speed", "curvature"), [*CURVES, (3.0, 1 / 10), (5.0, -1 / 7)])
def test_slip_compensation_settles_on_the_curve(speed: float, curvature: float) -> None:
    path = course([(curvature, 0.5 * math.pi / abs(curvature))])
    settled = drive(SlipCompensated(CAR), path, speed, 25.0)[-1]
    # At 7 m radius the slip angle is 12 degrees: with small angles 10 cm would remain.
    assert abs(settled.lateral) < 0.005
    assert settled.heading == pytest.approx(-math.asin(slip(speed) * curvature), abs=3e-4)


@pytest.mark.parametrize(
    ("speed", "radius", "most"),
    [(30.0, 500.0, 0.005), (20.0, 200.0, 0.003), (10.0, 60.0, 0.006), (5.0, 15.0, 0.018)],
)
def test_slip_compensation_keeps_to_the_path_where_its_curvature_jumps(
    speed: float, radius: float, most: float
) -> None:
    """Less than half of the error when following the curvature at the distance l."""
    path = course([(0.0, 2 * speed), (1 / radius, 2 * speed), (0.0, speed), (-1 / radius, speed)])
    history = drive(SlipCompensated(CAR), path, speed, 6.0)
    assert max(abs(errors.lateral) for errors in history) < most


@pytest.mark.parametrize(("speed", "curvature"), CURVES)
def test_stanley_settles_with_its_front_axle_on_the_curve(speed: float, curvature: float) -> None:
    path = course([(curvature, 0.5 * math.pi / abs(curvature))])
    settled = drive(Stanley(CAR), path, speed, 25.0)[-1]
    ahead = CAR.front_axle_distance
    inside = ahead * slip(speed) * curvature + 0.5 * curvature * ahead**2
    assert settled.lateral == pytest.approx(inside, abs=0.01)


@pytest.mark.parametrize(("speed", "curvature"), CURVES)
def test_pure_pursuit_turns_its_rear_axle_on_the_circle_through_the_goal(
    speed: float, curvature: float
) -> None:
    """On the curve the steering is the Ackermann angle."""
    law, rear = PurePursuit(CAR), CAR.rear_axle_distance
    # The rear axle is on the circle and tangent to it; the centre is b ahead on the tangent.
    heading = math.atan(rear * curvature)
    lateral = (1.0 - math.hypot(1.0, rear * curvature)) / curvature
    command = law.steer(TrackingErrors(lateral, -heading, 0.0, curvature), speed)
    assert command.steering == pytest.approx(math.atan(CAR.wheelbase * curvature), rel=0.01)
    assert command.feedforward == pytest.approx(math.atan(CAR.wheelbase * curvature))
