import math
from dataclasses import replace

import numpy as np
import pytest

from vehicles.car.dynamics import Body
from vehicles.car.imu import ExactSensor, ImuSettings, InertialSensor, Motion
from vehicles.schedule import SECOND

TICK = SECOND // 50
BODY = Body(3.0, -2.0, 7.0, 20.0, yaw_rate=0.2)
SILENT = ImuSettings(speed_noise=0.0, yaw_rate_noise=0.0, speed_bias=0.0, yaw_rate_bias=0.0)


def sensor(noise: ImuSettings, seed: int = 1, rate_hz: float = 50.0) -> InertialSensor:
    return InertialSensor(noise, rate_hz, 0, np.random.default_rng(seed))


def readings(noise: ImuSettings, count: int, seed: int = 1) -> list[Motion]:
    imu = sensor(noise, seed)
    taken = [imu.measure(BODY, k * TICK) for k in range(count)]
    return [motion for motion in taken if motion is not None]


def test_noise_is_white_and_of_the_stated_size() -> None:
    noise = replace(SILENT, speed_noise=0.05, yaw_rate_noise=0.002)
    for values, mean, deviation in (
        ([motion.speed for motion in readings(noise, 4000)], 20.0, 0.05),
        ([motion.yaw_rate for motion in readings(noise, 4000)], 0.2, 0.002),
    ):
        off = np.array(values) - mean
        assert np.mean(off) == pytest.approx(0.0, abs=4 * deviation / math.sqrt(4000))
        assert np.std(off) == pytest.approx(deviation, rel=0.05)
        assert abs(np.mean(off[1:] * off[:-1])) < 4 * deviation**2 / math.sqrt(4000)


def test_a_bias_is_constant_and_differs_from_vehicle_to_vehicle() -> None:
    noise = replace(SILENT, speed_bias=0.1, yaw_rate_bias=0.01)
    drawn = []
    for seed in range(400):
        first, *others = readings(noise, 3, seed)
        assert others == [first] * 2
        drawn.append((first.speed - 20.0, first.yaw_rate - 0.2))
    speeds, yaw_rates = np.array(drawn).T
    assert np.std(speeds) == pytest.approx(0.1, rel=0.1)
    assert np.std(yaw_rates) == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(speeds, yaw_rates)[0, 1]) < 0.2


def test_an_exact_sensor_gives_the_state_at_every_instant() -> None:
    assert ExactSensor().measure(BODY, 12345) is BODY


def test_readings_do_not_depend_on_how_many_are_drawn_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drawn = readings(ImuSettings(), 200)
    monkeypatch.setattr("vehicles.car.imu.BLOCK", 1)
    assert readings(ImuSettings(), 200) == drawn
