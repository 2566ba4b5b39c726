import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicles.car.dynamics import Body, tyre_use
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.tyres import GRAVITY, axle_loads, brush_force, linear_range

STIFFNESS, CAPACITY = 400_000.0, 9_000.0
SLIPS = st.floats(-1.0, 1.0)


@given(slip=SLIPS)
def test_a_brush_force_is_at_most_its_capacity_and_the_linear_force(slip: float) -> None:
    force = brush_force(slip, STIFFNESS, CAPACITY)
    assert abs(force) <= CAPACITY
    assert abs(force) <= STIFFNESS * abs(slip)
    assert force * slip <= 0.0
    assert brush_force(-slip, STIFFNESS, CAPACITY) == -force


def test_at_small_slip_it_is_the_linear_tyre_to_first_order() -> None:
    for slip in (1e-4, 1e-5):
        x = STIFFNESS * slip / (3.0 * CAPACITY)
        assert brush_force(slip, STIFFNESS, CAPACITY) == pytest.approx(
            -STIFFNESS * slip, rel=1.1 * x
        )


def test_full_sliding_begins_without_a_kink() -> None:
    full = 3.0 * CAPACITY / STIFFNESS
    assert brush_force(full, STIFFNESS, CAPACITY) == pytest.approx(-CAPACITY)
    assert brush_force(full * 0.999, STIFFNESS, CAPACITY) == pytest.approx(-CAPACITY, rel=2e-9)


def test_axle_loads_balance_about_the_centre_of_mass() -> None:
    front, rear = axle_loads(CAR)
    assert front + rear == pytest.approx(CAR.mass * GRAVITY)
    assert front * CAR.front_axle_distance == pytest.approx(rear * CAR.rear_axle_distance)


def test_the_linear_range_ends_at_20_percent_less_force() -> None:
    for slip, stiffness, load in zip(
        linear_range(CAR), (CAR.front_cornering_stiffness, CAR.rear_cornering_stiffness),
        axle_loads(CAR), strict=True,
    ):  # fmt: skip
        force = brush_force(slip, stiffness, CAR.friction * load)
        assert force == pytest.approx(-0.8 * stiffness * slip)
        assert abs(force) / (CAR.friction * load) == pytest.approx(0.517, abs=1e-3)


def test_linear_tyres_may_exceed_the_friction() -> None:
    """The linear model allows 90 m/s² of lateral acceleration, ten times the friction limit."""
    yaw_rate = 3.0
    usage = tyre_use(Body(0.0, 0.0, 0.0, 30.0, 0.0, yaw_rate, 0.0), 0.0, CAR)
    assert usage.friction_share > 5.0
    brush = tyre_use(
        Body(0.0, 0.0, 0.0, 30.0, 0.0, yaw_rate, 0.0), 0.0, replace(CAR, tyres="brush")
    )
    assert brush.friction_share == pytest.approx(1.0)
    assert (brush.front_slip, brush.rear_slip) == (usage.front_slip, usage.rear_slip)


def test_a_left_turn_has_negative_slip_and_accelerates_to_the_left() -> None:
    curvature, speed = 0.01, 20.0
    yaw_rate = speed * curvature
    lateral = CAR.steady_slip_per_curvature(speed) * yaw_rate
    steering = (CAR.wheelbase + CAR.steer_gradient * speed * speed) * curvature
    usage = tyre_use(Body(0.0, 0.0, 0.0, speed, lateral, yaw_rate, steering), 0.0, CAR)
    assert usage.lateral_acceleration == pytest.approx(speed * yaw_rate, rel=1e-9)
    assert usage.front_slip < 0.0
    assert usage.rear_slip < 0.0
    assert math.isclose(usage.friction_share, speed * yaw_rate / GRAVITY / CAR.friction)


def test_a_car_that_slides_sideways_has_a_slip_angle_near_90_degrees() -> None:
    usage = tyre_use(Body(0.0, 0.0, 0.0, 0.0, 15.0), 0.0, replace(CAR, tyres="brush"))
    assert 1.4 < usage.rear_slip < math.pi / 2
