"""Settings of the inertial sensor (TOML table `[imu]`)."""

from dataclasses import dataclass
from typing import Annotated

from vehicles.car.sensors.imu import InertialNoise
from vehicles.setting import Setting

NOISE = InertialNoise()


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSettings:
    """The emulated inertial sensor of a vehicle: gyroscope and wheel speed.

    All values are standard deviations. Biases are constant, and drawn once per vehicle.
    """

    rate: Annotated[
        float | None, Setting("rate; default: control.rate_hz", "hz", 0.01, 1000, example=50.0)
    ] = None
    speed_noise: Annotated[float, Setting("white noise of the speed", "mps", 0, 10)] = NOISE.speed
    speed_bias: Annotated[
        float, Setting("standard deviation of the bias of the speed", "mps", 0, 10)
    ] = NOISE.speed_bias
    yaw_rate_noise: Annotated[
        float, Setting("white noise of the yaw rate; the default equals 0.1 deg/s", "radps", 0, 1)
    ] = NOISE.yaw_rate
    yaw_rate_bias: Annotated[
        float, Setting("standard deviation of the bias of the yaw rate", "radps", 0, 1)
    ] = NOISE.yaw_rate_bias

    @property
    def noise(self) -> InertialNoise:
        return InertialNoise(
            self.speed_noise, self.yaw_rate_noise, self.speed_bias, self.yaw_rate_bias
        )
