"""White noise of a GNSS receiver."""

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class GnssNoise:
    """Standard deviations of the white Gaussian noise (Section III-A has that of the position).

    position (m) per axis: 2 cm, the paper's RTK receiver. heading (rad) 0.1 deg, speed (m/s), and
    yaw rate (rad/s) 0.1 deg/s: open-sky data of RTK-aided inertial units with two antennas and a
    MEMS gyroscope.
    """

    position: float = 0.02
    heading: float = math.radians(0.1)
    speed: float = 0.03
    yaw_rate: float = 0.00175

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{field.name} noise must be at least 0, not {value}")
