"""The gap sensor against closed forms of straight lines and circles."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.made.scenarios.messages import truth
from vehicles.car.dynamics import Body
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.car.sensors import GapMeasurement, GapSensor, GapSensorSettings
from vehicles.messages import TruePose
from vehicles.schedule import MILLISECOND, SECOND, Cadence

EXACT = GapSensorSettings(reach=100.0, gap_noise=0.0, gap_rate_noise=0.0)
TRUCK = replace(LINCOLN_MKZ, length=12.0, front_axle_distance=3.0, rear_axle_distance=3.0)
FRONT = 0.5 * (
    LINCOLN_MKZ.length + LINCOLN_MKZ.front_axle_distance - LINCOLN_MKZ.rear_axle_distance
)
TICK = 10 * MILLISECOND


def pose(body: Body, at: int = 0) -> TruePose:
    return replace(
        truth("v1", 0, 0.0, 0.0),
        true_at_ns=at,
        east_m=body.east,
        north_m=body.north,
        yaw_rad=body.yaw,
        speed_mps=body.speed,
        lateral_speed_mps=body.lateral_speed,
        yaw_rate_radps=body.yaw_rate,
    )


def measured(
    settings: GapSensorSettings,
    own: Body,
    target_at: Callable[[int], TruePose | None],
    *,
    seconds: float = 0.2,
    seed: int = 1,
) -> list[tuple[int, GapMeasurement]]:
    """Measurements behind a car that stays where it is, with the instants of their arrival."""
    sensor = GapSensor(settings, LINCOLN_MKZ, TRUCK, Cadence(0, 100.0), np.random.default_rng(seed))
    ticks = range(0, round(seconds * SECOND), TICK)
    taken = [(now, sensor.measure(own, now, target_at)) for now in ticks]
    return [(now, one) for now, one in taken if one is not None]


def on_circle(radius: float, angle: float, speed: float) -> Body:
    """Body that drives around the origin to the left."""
    return Body(
        east=radius * math.cos(angle),
        north=radius * math.sin(angle),
        yaw=angle + 0.5 * math.pi,
        speed=speed,
        yaw_rate=speed / radius,
    )


def test_on_a_straight_it_is_the_gap_between_the_bumpers_and_their_difference_in_speed() -> None:
    own, ahead = Body(5.0, 2.0, math.pi, 20.0), Body(-35.0, 2.0, math.pi, 17.5)
    (_, first), *_ = measured(EXACT, own, lambda _: pose(ahead))
    assert first.gap == pytest.approx(40.0 - FRONT - 6.0, abs=1e-9)
    assert first.rate == pytest.approx(-2.5, abs=1e-9)


@pytest.mark.parametrize("radius", [15.0, 60.0, -60.0, 500.0])
def test_on_a_circle_it_is_the_chord_between_the_bumpers(radius: float) -> None:
    own_speed, its_speed, spacing = 8.0, 9.5, 25.0

    def chord(seconds: float) -> float:
        """Law of cosines, with the bumpers at a right angle to the radii of their cars."""
        angle = (spacing + (its_speed - own_speed) * seconds) / abs(radius)
        behind = angle + math.atan2(-6.0, abs(radius)) - math.atan2(FRONT, abs(radius))
        r_front, r_rear = math.hypot(radius, FRONT), math.hypot(radius, 6.0)
        return math.sqrt(r_front**2 + r_rear**2 - 2.0 * r_front * r_rear * math.cos(behind))

    turn = 1.0 if radius > 0.0 else -1.0
    own, ahead = (
        on_circle(abs(radius), at, speed)
        for at, speed in ((0.3, own_speed), (0.3 + spacing / abs(radius), its_speed))
    )
    if turn < 0.0:  # mirrored
        own, ahead = (
            replace(one, north=-one.north, yaw=-one.yaw, yaw_rate=-one.yaw_rate)
            for one in (own, ahead)
        )
    wide = replace(EXACT, field_of_view=math.pi)
    (_, first), *_ = measured(wide, own, lambda _: pose(ahead))
    assert first.gap == pytest.approx(chord(0.0), abs=1e-9)
    assert first.rate == pytest.approx((chord(1e-4) - chord(-1e-4)) / 2e-4, abs=1e-5)


def test_measurements_arrive_after_the_latency_and_are_of_their_instant() -> None:
    own = Body(0.0, 0.0, 0.0, 20.0)

    def target_at(at: int) -> TruePose:
        return pose(Body(30.0 + 10.0 * at / SECOND, 0.0, 0.0, 30.0), at)

    settings = replace(EXACT, rate=10.0, latency=75 * MILLISECOND)
    taken = measured(settings, own, target_at, seconds=0.4)
    assert [now for now, _ in taken] == [
        80 * MILLISECOND,
        180 * MILLISECOND,
        280 * MILLISECOND,
        380 * MILLISECOND,
    ]
    assert [one.measured_at for _, one in taken] == [k * SECOND // 10 for k in range(4)]
    for _, one in taken:
        assert one.gap == pytest.approx(24.0 - FRONT + 10.0 * one.measured_at / SECOND, abs=1e-9)


@pytest.mark.parametrize(
    ("east", "north", "is_seen"),
    [
        (100.0, 0.0, True),
        (110.0, 0.0, False),
        (30.0, 20.0, True),
        (20.0, 30.0, False),
        (-30.0, 0.0, False),
    ],
)
def test_range_and_angle_of_view_are_limits(*, east: float, north: float, is_seen: bool) -> None:
    taken = measured(EXACT, Body(0.0, 0.0, 0.0, 0.0), lambda _: pose(Body(east, north, 0.0, 0.0)))
    assert {math.isfinite(one.gap) for _, one in taken} == {is_seen}


def test_noise_depends_on_seed_and_instant_only() -> None:
    noisy = replace(EXACT, rate=50.0, gap_noise=0.3, gap_rate_noise=0.1)
    own, ahead = Body(0.0, 0.0, 0.0, 20.0), Body(40.0, 0.0, 0.0, 20.0)
    always = measured(noisy, own, lambda at: pose(ahead, at), seconds=60.0)
    gaps, rates = (
        np.array(values) for values in zip(*((one.gap, one.rate) for _, one in always), strict=True)
    )
    assert gaps.mean() == pytest.approx(34.0 - FRONT, abs=0.02)
    assert gaps.std() == pytest.approx(0.3, rel=0.05)
    assert rates.std() == pytest.approx(0.1, rel=0.05)
    assert abs(np.corrcoef(gaps[1:], gaps[:-1])[0, 1]) < 0.06
    rarely = measured(
        noisy, own, lambda at: pose(ahead, at) if at % (7 * 20 * MILLISECOND) == 0 else None
    )
    seen = {now: one for now, one in rarely if math.isfinite(one.gap)}
    assert seen.items() <= dict(always).items()
    assert len(seen) == 2
    assert measured(noisy, own, lambda at: pose(ahead, at), seed=2)[0] != always[0]
