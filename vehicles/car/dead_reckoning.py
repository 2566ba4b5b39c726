"""How a car moves on by what its inertial sensor says, and how wrong that becomes.

Gyroscope and wheels tell yaw rate and speed; how fast the car drifts sideways follows from the
yaw rate by the single-track model. The densities below are what a filter that corrects dead
reckoning by fixes has to allow for.
"""

import math
from typing import Final

from vehicles.car.imu import InertialNoise
from vehicles.car.parameters import VehicleParameters

QUICKEST_LAG: Final = 1e-3
"""Least time constant (s) of the slip, for a car that hardly moves."""

UNKNOWN_LOAD: Final = 0.25
"""Share of the car's mass by which the assumed load may be wrong: four passengers with luggage are
480 kg on 1896 kg (Section V-B). The steady slip is wrong by that share of its part that comes from
the mass."""

LASTING: Final = 0.5
"""Time (s) for which an error of the slip lasts: half of the second that the paper gives a piece of
road between two changes of curvature (Section III-A)."""

SIDE_DRIFT: Final = 0.003
"""Sideways speed (m/s) that has no cause in the model: camber, wind."""

YAW_JERK: Final = 5.0
"""Change of yaw acceleration (rad/s³) between readings: an emergency lane change at 30 m/s."""

JERK: Final = 10.0
"""Change of acceleration (m/s³) between readings: the onset of hard braking."""


class SlipModel:
    """Lateral speed (m/s) of the centre of mass from the yaw rate r, by eqs. (1), (2).

    Without the front axle's force, which the steering decides, they leave
    v_y' = (l r - v_y) / tau + (I / m a) r', with the steady slip l = b - s v² of
    `VehicleParameters.steady_slip_per_curvature`, tau = s v and s = m a / (L C_r). So a yaw rate
    that is measured tells the slip in transients, too, as far as mass and tyres are known.
    """

    def __init__(self, parameters: VehicleParameters) -> None:
        """`parameters` are those assumed of the car."""
        p = parameters
        moment = p.mass * p.front_axle_distance
        self._rear = p.rear_axle_distance
        self._sag = moment / (p.wheelbase * p.rear_cornering_stiffness)
        self._kick = p.yaw_inertia / moment

    def steady(self, speed: float, yaw_rate: float) -> float:
        """Lateral speed (m/s) in steady cornering, eqs. (1), (2) at rest."""
        return (self._rear - self._sag * speed * speed) * yaw_rate

    def after(
        self, span: float, speed: float, before: float, now: float, lateral_speed: float
    ) -> float:
        """Lateral speed `span` (s > 0) later; the yaw rate goes evenly from `before` to `now`.

        The exact solution of eqs. (1), (2) as above, for a yaw rate that is a ramp.
        """
        steady = self._rear - self._sag * speed * speed
        lag = self._sag * speed
        if lag < QUICKEST_LAG:
            lag = QUICKEST_LAG
        kept = math.exp(-span / lag)
        ramp = (self._kick - steady) * (now - before) * (lag * (1.0 - kept) / span)
        return kept * lateral_speed + steady * (now - kept * before) + ramp

    def error(self, speed: float, yaw_rate: float) -> float:
        """Standard deviation (m/s) of the lateral speed: load not known, drift without a cause.

        The mass enters the steady slip of eqs. (1), (2) in proportion.
        """
        return UNKNOWN_LOAD * self._sag * speed * speed * abs(yaw_rate) + SIDE_DRIFT


class DriftModel:
    """How fast dead reckoning goes wrong, biases apart.

    Densities of random walks, standard deviation² per time: `along` and `across` the body (m²/s),
    `heading` (rad²/s). White noise of deviation s held for T walks with density s² T.
    """

    def __init__(self, slip: SlipModel, noise: InertialNoise, rate_hz: float) -> None:
        """`noise` of the readings, of which there are `rate_hz` per second."""
        self._slip = slip
        period = 1.0 / rate_hz
        between = period * period / 12.0  # of a change of slope missed by joining two readings
        self.along = period * (noise.speed**2 + (JERK * between) ** 2)
        self.heading = period * (noise.yaw_rate**2 + (YAW_JERK * between) ** 2)

    def across(self, speed: float, yaw_rate: float) -> float:
        """Density across the body (m²/s) at a motion: of the slip's error.

        One of deviation s that lasts for a time t (a Gauss–Markov process) walks with 2 s² t.
        """
        return 2.0 * LASTING * self._slip.error(speed, yaw_rate) ** 2
